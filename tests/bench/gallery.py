#!/usr/bin/env python3
"""Backward, forward, their plain average and bidirectional, side by side at equal time, with their errors.

    .venv/bin/python tests/bench/gallery.py 10 scenes/gallery.png ring glass-spheres hidden-lamps

renders each scene of scenes/ for 10 s by each integrator (the average: of one render of 5 s by each of the first two), writes the images as one PNG, a row per
scene, and prints relMSE, the mean of (I - R)^2 / (R^2 + 0.01). The reference is a `bdpt` render of 30 times the time with another seed; its own
error is estimated from the difference of two halves.
"""

import json
import pathlib
import subprocess
import sys
import tempfile

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")

PROJECT = pathlib.Path(__file__).resolve().parents[2]
SIZE = "256x256"


def load(path):
    bitmap = mi.Bitmap(str(path)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False)
    return np.array(bitmap, dtype=np.float64)


def render(scene, integrator, seconds, seed):
    with tempfile.TemporaryDirectory() as folder:
        image = pathlib.Path(folder) / "image.exr"
        command = [PROJECT / "target/release/helmholtz", "render", PROJECT / f"scenes/{scene}.xml", "--size", SIZE]
        command += ["--integrator", integrator, "--time", f"{seconds}s", "--seed", str(seed), "--quiet", "--json", "-o", image]
        passes = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)["passes"]
        return load(image), passes


def rel_mse(image, reference):
    return float(((image - reference) ** 2 / (reference**2 + 0.01)).mean())


def main():
    seconds, output, scenes = float(sys.argv[1]), sys.argv[2], sys.argv[3:]
    rows = []
    for scene in scenes:
        depth = "max_depth=10"
        halves = [render(scene, f"bdpt:{depth}", 15 * seconds, seed)[0] for seed in (900, 901)]
        reference = (halves[0] + halves[1]) / 2
        noise = rel_mse(halves[0], halves[1]) / 4
        print(f"{scene}: the reference's own relMSE is about {noise:.2g}")
        backward, forward, bidirectional = (render(scene, f"{name}:{depth}", seconds, 1) for name in ("path", "ptracer", "bdpt"))
        parts = [render(scene, f"{name}:{depth}", seconds / 2, 2)[0] for name in ("path", "ptracer")]
        average = (parts[0] + parts[1]) / 2
        for name, (image, passes) in (("path", backward), ("ptracer", forward), ("bdpt", bidirectional)):
            print(f"  {name:8} {passes:6} passes, relMSE {rel_mse(image, reference):.5f}")
        print(f"  average of path and ptracer, half the time each: relMSE {rel_mse(average, reference):.5f}", flush=True)
        rows.append(np.concatenate([backward[0], forward[0], average, bidirectional[0], reference], axis=1))
    sheet = np.concatenate(rows, axis=0).astype(np.float32)
    mi.Bitmap(sheet).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.UInt8, True).write(output)


if __name__ == "__main__":
    main()
