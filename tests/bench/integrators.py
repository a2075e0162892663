#!/usr/bin/env python3
"""Error at equal time of several integrators on one scene, ours and Mitsuba's, in turns on one machine.

    .venv/bin/python tests/bench/integrators.py scenes/hidden-lamps.xml 20 REFERENCE.exr path bdpt ptracer mitsuba:llvm_ad_rgb:ptracer

REFERENCE is a long render of the same scene, size and max_depth with another seed, for instance
    target/release/helmholtz render scenes/hidden-lamps.xml --size 256x256 --integrator bdpt:max_depth=8 --spp 4000 --seed 999 -o REFERENCE.exr
Ours may have parameters, as in `vpl:count=1000,visibility=shadowmap`. `mitsuba:VARIANT:PLUGIN` is a plugin of Mitsuba; its llvm variants need DRJIT_LIBLLVM_PATH. Prints samples per second and relMSE, mean of
(I - R)^2 / (R^2 + 0.01), each the median of three runs; the border of 4 pixels, where Mitsuba cuts its filter, is left out. Mitsuba's error is scaled to
the exact time, as it cannot be told to stop; its first render, which compiles, does not count.
"""

import json
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import mitsuba as mi
import numpy as np

PROJECT = pathlib.Path(__file__).resolve().parents[2]
BORDER = 4
DEPTH = 8
RUNS = 3

mi.set_variant("scalar_rgb")


def load(path):
    bitmap = mi.Bitmap(str(path)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False)
    return np.array(bitmap, dtype=np.float64)


def rel_mse(image, reference):
    inner = (slice(BORDER, -BORDER), slice(BORDER, -BORDER))
    a, b = image[inner], reference[inner]
    return float(((a - b) ** 2 / (b**2 + 0.01)).mean())


def ours(scene, integrator, seconds, size, seed, depth=DEPTH):
    """Image, samples per pixel and time. `integrator` may have parameters; a depth of -1 is no limit."""
    name = f"{integrator}{',' if ':' in integrator else ':'}max_depth={depth}"
    with tempfile.TemporaryDirectory() as folder:
        image = pathlib.Path(folder) / "image.exr"
        command = [PROJECT / "target/release/helmholtz", "render", scene, "--time", f"{seconds}s", "--size", f"{size[0]}x{size[1]}"]
        command += ["--integrator", name, "--seed", str(seed), "--quiet", "--json", "-o", image]
        report = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
        return load(image), report["passes"], report["render_seconds"]


def reference(folder, scene, integrator, seconds, size, depth):
    """Mean of two halves, kept in a folder and rendered for `seconds` each if they are not there. Prints the relMSE of its noise."""
    folder.mkdir(parents=True, exist_ok=True)
    halves = []
    for seed in (9001, 9002):
        path = folder / f"{scene.stem}-{size[0]}x{size[1]}-{depth}-{seed}.exr"
        if not path.exists():
            image, _, _ = ours(scene, integrator, seconds, size, seed, depth)
            mi.Bitmap(image.astype(np.float32)).write(str(path))
        halves.append(load(path))
    noise = rel_mse(*halves) / 4
    print(f"{scene.stem}: reference by {integrator}; its noise is about relMSE {noise:.2g}", flush=True)
    return (halves[0] + halves[1]) / 2


def mitsubas(scene, variant, plugin, seconds, size, seed, depth=DEPTH):
    """As `ours`, by a plugin of Mitsuba; its first render, which compiles, does not count."""
    mi.set_variant(variant)
    loaded = mi.load_file(str(scene))
    sensor = mi.traverse(loaded.sensors()[0])
    sensor["film.size"] = list(size)
    sensor.update()
    integrator = mi.load_dict({"type": plugin, "max_depth": depth})

    def render(spp):
        start = time.time()
        image = np.array(mi.render(loaded, integrator=integrator, spp=spp, seed=seed), dtype=np.float64)
        return image, time.time() - start

    render(1)
    _, trial = render(8)
    spp = max(1, int(8 * seconds / trial))
    image, elapsed = render(spp)
    mi.set_variant("scalar_rgb")
    return image, spp, elapsed


def main():
    scene, seconds, reference = pathlib.Path(sys.argv[1]), float(sys.argv[2]), load(sys.argv[3])
    size = (reference.shape[1], reference.shape[0])
    results = {integrator: [] for integrator in sys.argv[4:]}
    for run in range(RUNS):
        for integrator, found in results.items():
            if integrator.startswith("mitsuba:"):
                _, variant, plugin = integrator.split(":")
                image, spp, elapsed = mitsubas(scene, variant, plugin, seconds, size, 10 + run)
            else:
                image, spp, elapsed = ours(scene, integrator, seconds, size, 10 + run)
            error = rel_mse(image, reference) * elapsed / seconds
            found.append((spp * size[0] * size[1] / elapsed / 1e6, error))
    for integrator, found in results.items():
        rate, error = (statistics.median(values) for values in zip(*found))
        print(f"{integrator:32} {rate:6.2f} M samples/s, relMSE {error:.5f}", flush=True)


if __name__ == "__main__":
    main()
