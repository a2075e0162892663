#!/usr/bin/env python3
"""Published scenes through Mitsuba 3 and through us, compared by statistics and side by side.

    .venv/bin/python tests/bench/published_scenes.py OUT --width 160 --spp 64 --runs 8 [--scenes NAME ...]

renders each scene below ../shared/testdata/scenes (or those named) by `path` of the same depth, `runs` times with seeds of their own on both sides, writes
OUT/NAME.png (Mitsuba's, ours, and the difference in units of its error: grey is none, white and black six), and prints per scene: the greatest relative
difference of the means of the channels with its z, and how many blocks of 8x8 pixels differ by more than the limit, which by Student's t with the
degrees of freedom that there are happens in one of 1000 scenes by chance. Long tails make that more often in scenes of rare bright paths: a difference is
real if it stays in place with other seeds.
"""

import argparse
import json
import pathlib
import subprocess
import tempfile
import time

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")

PROJECT = pathlib.Path(__file__).resolve().parents[2]
SCENES = PROJECT / "../shared/testdata/scenes"
BLOCK = 8

# File and depth of paths.
TABLE = {
    "country-kitchen": ("country-kitchen/kitchen_v3.xml", 8),
    "veach-bidir": ("veach-bidir/scene.xml", 8),
    "staircase2": ("staircase2/scene.xml", 8),
    "sponza": ("sponza/sponza_v3.xml", 6),
    "torus": ("torus/torus_v3.xml", 8),
    "torus-obj": ("torus/torus_obj_v3.xml", 8),
    "sms-ring": ("sms-ring/ring_v3.xml", 6),
    "sms-notebook": ("sms-ring/ring_notebook_normalmapped_v3.xml", 6),
    "cbox": ("cbox/cbox_v3.xml", 8),
}


def theirs(path, width, spp, runs, depth):
    """Images of Mitsuba: film and integrator replaced, everything else as in the file."""
    scene = mi.load_file(str(path))
    params = mi.traverse(scene)
    film = next(key for key in params.keys() if key.endswith("film.size"))
    size = np.array(params[film])
    height = int(round(width * size[1] / size[0]))
    params[film] = [width, height]
    crop_size = film.replace("film.size", "film.crop_size")
    params[crop_size], params[film.replace("film.size", "film.crop_offset")] = [width, height], [0, 0]
    params.update()
    integrator = mi.load_dict({"type": "path", "max_depth": depth, "rr_depth": 1000})
    start = time.perf_counter()
    images = [np.array(mi.render(scene, integrator=integrator, spp=spp, seed=run + 1))[:, :, :3] for run in range(runs)]
    return np.array(images, dtype=np.float64), height, time.perf_counter() - start


def ours(path, width, height, spp, runs, depth):
    images, notes = [], ""
    start = time.perf_counter()
    for run in range(runs):
        with tempfile.TemporaryDirectory() as folder:
            image = pathlib.Path(folder) / "image.exr"
            command = [PROJECT / "target/release/helmholtz", "render", path, "--size", f"{width}x{height}", "--spp", str(spp), "--seed", str(run)]
            command += ["--integrator", f"path:max_depth={depth},rr_depth=1000", "--lenient", "--json", "-o", image]
            done = subprocess.run(command, check=True, capture_output=True, text=True)
            assert json.loads(done.stdout)["dropped"]["samples"] == 0, "dropped samples"
            notes = done.stderr
            bitmap = mi.Bitmap(str(image)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False)
            images.append(np.array(bitmap, dtype=np.float64))
    return np.array(images), notes, time.perf_counter() - start


def blocks(images):
    runs, height, width, channels = images.shape
    height, width = height // BLOCK * BLOCK, width // BLOCK * BLOCK
    cut = images[:, :height, :width].reshape(runs, height // BLOCK, BLOCK, width // BLOCK, BLOCK, channels)
    return cut.mean(axis=(2, 4))


def z_scores(a, b):
    """Difference of the means over the first axis in units of its error."""
    error = np.sqrt(a.var(axis=0, ddof=1) / len(a) + b.var(axis=0, ddof=1) / len(b))
    difference = a.mean(axis=0) - b.mean(axis=0)
    # Where neither varies, rounding is left.
    floor = 1e-5 * np.abs(b.mean())
    return np.where(np.abs(difference) <= floor, 0, difference / np.maximum(error, 1e-30))


def limit(count, degrees):
    """The t that one of `count` numbers exceeds with a chance of 1/1000, by bisection of the tail of Student's t."""
    from math import lgamma, exp, sqrt, pi

    norm = exp(lgamma((degrees + 1) / 2) - lgamma(degrees / 2)) / sqrt(degrees * pi)
    t = np.linspace(0, 200, 2_000_001)
    density = norm * (1 + t**2 / degrees) ** (-(degrees + 1) / 2)
    tail = 1 - 2 * np.cumsum(density) * (t[1] - t[0])
    return float(t[np.searchsorted(-tail, -1e-3 / count)])


def picture(image, exposure):
    x = np.clip(image * exposure, 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--width", type=int, default=160)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--runs", type=int, default=8)
    parser.add_argument("--depth", type=int, help="of paths, instead of each scene's own: 2 leaves out caustics, which path hardly finds")
    parser.add_argument("--scenes", nargs="+", choices=list(TABLE), default=list(TABLE))
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for name in arguments.scenes:
        file, depth = TABLE[name]
        path, depth = SCENES / file, arguments.depth or depth
        reference, height, their_time = theirs(path, arguments.width, arguments.spp, arguments.runs, depth)
        images, notes, our_time = ours(path, arguments.width, height, arguments.spp, arguments.runs, depth)
        (arguments.out / f"{name}.log").write_text(notes)
        whole = z_scores(images.mean(axis=(1, 2)), reference.mean(axis=(1, 2)))
        means = images.mean(axis=(0, 1, 2)), reference.mean(axis=(0, 1, 2))
        relative = means[0] / means[1] - 1
        worst = int(np.abs(relative).argmax())
        z = z_scores(blocks(images), blocks(reference))
        # Of two samples of `runs` with unequal variances, the least degrees of freedom.
        bound = limit(z.size, arguments.runs - 1)
        beyond = int((np.abs(z).max(axis=2) > bound).sum())
        print(
            f"{name}: mean {relative[worst]:+.2%} (z {whole[worst]:+.1f}), {beyond} of {z[..., 0].size} blocks beyond {bound:.1f}, "
            f"rms z {np.sqrt((z**2).mean()):.2f}; {their_time:.0f} s and {our_time:.0f} s",
            flush=True,
        )
        exposure = 0.5 / np.median(reference.mean(axis=(0, 3)).clip(1e-6))
        grey = 0.5 + np.repeat(np.repeat(z.mean(axis=2, keepdims=True), BLOCK, 0), BLOCK, 1) / 12
        grey = np.repeat(grey, 3, axis=2).clip(0, 1)
        grey = np.pad(grey, ((0, height - grey.shape[0]), (0, arguments.width - grey.shape[1]), (0, 0)), constant_values=0.5)
        sheet = np.concatenate([picture(reference.mean(axis=0), exposure), picture(images.mean(axis=0), exposure), grey], axis=1)
        bytes_ = (sheet * 255 + 0.5).astype(np.uint8)
        mi.Bitmap(bytes_).write(str(arguments.out / f"{name}.png"))


if __name__ == "__main__":
    main()
