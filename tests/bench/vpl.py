#!/usr/bin/env python3
"""What visibility costs virtual point lights: a pass of 512x512 by rays, by shadow maps and without, in turns on one machine.

    .venv/bin/python tests/bench/vpl.py scenes/cornell-box.xml [COUNT]

COUNT light paths (by default as many as leave about 1000 lights). All three have the same lights, and neither direct light's nor compensation's noise is in
the way of the comparison: one pass each, the same seed. Prints the least time of three runs, the ratio to rays, and the error against the image by
rays: mean of |I - R| over mean of R, and mean of (I - R)^2 / (R^2 + 0.01).
"""

import json
import pathlib
import subprocess
import sys
import tempfile

import mitsuba as mi
import numpy as np

PROJECT = pathlib.Path(__file__).resolve().parents[2]
WANTED_LIGHTS = 1000
RUNS = 3
KINDS = ["rays", "shadowmap,resolution=64", "shadowmap,resolution=128", "none"]

mi.set_variant("scalar_rgb")


def render(scene, visibility, count, size="512x512"):
    """Image, and the report of the render."""
    with tempfile.TemporaryDirectory() as folder:
        image = pathlib.Path(folder) / "image.exr"
        integrator = f"vpl:max_depth=8,count={count},compensate=false,visibility={visibility}"
        command = [PROJECT / "target/release/helmholtz", "render", scene, "--spp", "1", "--size", size]
        command += ["--integrator", integrator, "--quiet", "--json", "-o", image]
        report = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
        bitmap = mi.Bitmap(str(image)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False)
        return np.array(bitmap, dtype=np.float64), report


def main():
    scene = pathlib.Path(sys.argv[1])
    if len(sys.argv) > 2:
        count = int(sys.argv[2])
    else:
        _, report = render(scene, "none", 1000, "16x16")
        count = max(1, round(1000 * WANTED_LIGHTS / report["photons"]))
    times, images, lights = {kind: [] for kind in KINDS}, {}, 0
    for _ in range(RUNS):
        for kind in KINDS:
            images[kind], report = render(scene, kind, count)
            times[kind].append(report["render_seconds"])
            lights = report["photons"]
    print(f"{count} light paths, {lights} lights")
    reference, rays = images["rays"], min(times["rays"])
    for kind in KINDS:
        difference = images[kind] - reference
        absolute = np.abs(difference).mean() / reference.mean()
        relative = (difference**2 / (reference**2 + 0.01)).mean()
        seconds = min(times[kind])
        print(f"{kind:26} {seconds:7.2f} s, {rays / seconds:5.2f} times as fast as rays, error {absolute:.4f}, relMSE {relative:.6f}")


if __name__ == "__main__":
    main()
