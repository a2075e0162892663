#!/usr/bin/env python3
"""Error at equal time on the Cornell box: Helmholtz's `path` against Mitsuba's, run in turns on one machine.

    .venv/bin/python tests/bench/equal_time.py scalar_rgb 20 REFERENCE.exr

REFERENCE is a long render of the same scene with another seed, for instance
    target/release/helmholtz render scenes/cornell-box.xml --spp 640 --seed 999 -o REFERENCE.exr
The llvm variants need DRJIT_LIBLLVM_PATH. Prints samples per second and relMSE, mean of (I - R)^2 / (R^2 + 0.01), of each run; the border of 4
pixels, where Mitsuba cuts its filter, is left out. Mitsuba's error is scaled to the exact time, as it cannot be told to stop.
"""

import json
import pathlib
import subprocess
import sys
import tempfile
import time

import mitsuba as mi
import numpy as np

PROJECT = pathlib.Path(__file__).resolve().parents[2]
BORDER = 4


def load(path):
    bitmap = mi.Bitmap(str(path)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False)
    return np.array(bitmap, dtype=np.float64)


def main():
    variant, seconds, reference_path = sys.argv[1], float(sys.argv[2]), sys.argv[3]
    mi.set_variant(variant)
    reference = load(reference_path)
    height, width = reference.shape[:2]
    inner = (slice(BORDER, -BORDER), slice(BORDER, -BORDER))

    def rel_mse(image):
        a, b = np.asarray(image, dtype=np.float64)[inner], reference[inner]
        return float(((a - b) ** 2 / (b**2 + 0.01)).mean())

    description = mi.cornell_box()
    description["sensor"]["film"]["width"], description["sensor"]["film"]["height"] = width, height
    scene = mi.load_dict(description)

    def render_mitsuba(spp, seed):
        start = time.time()
        image = np.array(mi.render(scene, spp=spp, seed=seed))
        return image, time.time() - start

    render_mitsuba(1, 1)  # compiles
    for run in range(3):
        with tempfile.TemporaryDirectory() as folder:
            image = pathlib.Path(folder) / "ours.exr"
            command = [PROJECT / "target/release/helmholtz", "render", PROJECT / "scenes/cornell-box.xml", "--time", f"{seconds}s"]
            command += ["--seed", str(100 + run), "--quiet", "--json", "-o", image]
            ours = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
            rate = ours["passes"] * width * height / ours["render_seconds"] / 1e6
            print(f"helmholtz {rate:.2f} M samples/s, relMSE {rel_mse(load(image)):.6f}")
        _, trial = render_mitsuba(8, 2)
        spp = max(1, int(8 * seconds / trial))
        image, elapsed = render_mitsuba(spp, 7 + run)
        rate = spp * width * height / elapsed / 1e6
        print(f"{variant} {rate:.2f} M samples/s, relMSE {rel_mse(image) * elapsed / seconds:.6f}", flush=True)


if __name__ == "__main__":
    main()
