#!/usr/bin/env python3
"""Backward, forward, their plain average and bidirectional, side by side at equal time, with their errors: the README's gallery, and "do both, and average?".

    .venv/bin/python tests/bench/gallery.py 10 REFERENCES scenes/gallery.jpg ring glass-spheres hidden-lamps

renders each scene of scenes/ for 10 s by each integrator (the average: of one render of 5 s by each of the first two), writes the images as one JPEG, a row per
scene with the reference at its end, and prints relMSE, the mean of (I - R)^2 / (R^2 + 0.01) without a border of 4 pixels. References are by `bdpt` with other seeds,
for 20 times the time, and kept in the folder REFERENCES.
"""

import pathlib
import sys

import mitsuba as mi
import numpy as np

from integrators import PROJECT, ours, reference, rel_mse

SIZE = (256, 256)
DEPTH = 10
REFERENCE_TIMES = 20


def main():
    seconds, references, output, scenes = float(sys.argv[1]), pathlib.Path(sys.argv[2]), sys.argv[3], sys.argv[4:]
    rows = []
    for scene in scenes:
        path = PROJECT / f"scenes/{scene}.xml"
        expected = reference(references, path, "bdpt", REFERENCE_TIMES * seconds / 2, SIZE, DEPTH)

        def render(integrator, seconds, seed):
            return ours(path, integrator, seconds, SIZE, seed, DEPTH)[:2]

        images = {}
        for name in ("path", "ptracer", "bdpt"):
            images[name], passes = render(name, seconds, 1)
            print(f"  {name:8} {passes:6} passes, relMSE {rel_mse(images[name], expected):.5f}")
        average = (render("path", seconds / 2, 2)[0] + render("ptracer", seconds / 2, 2)[0]) / 2
        print(f"  average of path and ptracer, half the time each: relMSE {rel_mse(average, expected):.5f}", flush=True)
        rows.append(np.concatenate([images["path"], images["ptracer"], average, images["bdpt"], expected], axis=1))
    sheet = np.concatenate(rows, axis=0).astype(np.float32)
    mi.Bitmap(sheet).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.UInt8, True).write(output, quality=88)


if __name__ == "__main__":
    main()
