#!/usr/bin/env python3
"""Renders scenes with Mitsuba 3 (scalar_rgb) as references for statistical tests.

Each scene is rendered in independent runs with seeds of their own. For a scene NAME.xml two files are written:

NAME.json  width, height, runs, spp (samples per pixel in a run) and
           the version of Mitsuba
NAME.f32   little-endian floats: every run's image, rows from the top, three channels (r, g, b) interleaved

Any failure ends the program with a message and an exit code other than 0. Needs `pip install mitsuba`.
"""

import argparse
import json
import multiprocessing
import pathlib
import sys
import time

import numpy as np

VARIANT = "scalar_rgb"


def render(path, spp, runs, out):
    """Renders one scene and writes its two files; returns a line to print."""
    import drjit
    import mitsuba

    mitsuba.set_variant(VARIANT)
    start = time.monotonic()
    # Reading OpenEXR waits forever for a second thread.
    drjit.set_thread_count(2)
    scene = mitsuba.load_file(str(path))
    drjit.set_thread_count(1)
    spp = spp or scene.sensors()[0].sampler().sample_count()
    width, height = (int(n) for n in scene.sensors()[0].film().crop_size())

    images = []
    for seed in range(1, runs + 1):
        # `moment` and `aov` append channels of their own.
        image = np.array(mitsuba.render(scene, spp=spp, seed=seed), dtype=np.float64)[:, :, :3]
        if image.shape != (height, width, 3):
            raise ValueError(f"image of shape {image.shape} instead of {(height, width, 3)}: the film's pixel_format must be rgb")
        if not np.isfinite(image).all():
            raise ValueError(f"{np.count_nonzero(~np.isfinite(image))} values of run {seed} are not finite")
        images.append(image)
    images = np.array(images)
    if not images.std(axis=0).max() > 0:
        raise ValueError("all runs are the same: the seed has no effect")

    description = {
        "scene": path.name,
        "width": width,
        "height": height,
        "runs": runs,
        "spp": spp,
        "mitsuba": mitsuba.__version__,
    }
    (out / f"{path.stem}.f32").write_bytes(images.astype("<f4").tobytes())
    # Last, so that a description never lacks its data.
    (out / f"{path.stem}.json").write_text(json.dumps(description, indent=1) + "\n")
    seconds = time.monotonic() - start
    return f"{path.stem}: mean {images.mean():.4g}, {runs} x {spp} spp, {seconds:.1f} s"


def render_or_say_why(job):
    """Turns an exception into text, which unlike some of Mitsuba's exceptions can cross to the parent process."""
    try:
        return True, render(*job)
    except Exception as error:  # whatever it is, the parent reports it and fails
        return False, f"{job[0]}: {type(error).__name__}: {error}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scenes", nargs="+", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path, required=True, help="directory for the results")
    parser.add_argument("--spp", type=int, help="samples per pixel in a run; by default the scene's sample_count")
    parser.add_argument("--runs", type=int, default=16, help="independent runs, at least 2 (default 16)")
    parser.add_argument("--workers", type=int, default=2, help="processes, each with one thread (default 2)")
    arguments = parser.parse_args()
    if arguments.runs < 2:
        parser.error("--runs must be at least 2 for a standard error")
    if len({path.stem for path in arguments.scenes}) != len(arguments.scenes):
        parser.error("two scenes have the same name")
    arguments.out.mkdir(parents=True, exist_ok=True)

    jobs = [(path, arguments.spp, arguments.runs, arguments.out) for path in arguments.scenes]
    # Spawned: a variant cannot be set in a fork of a process that already runs Mitsuba's threads.
    with multiprocessing.get_context("spawn").Pool(arguments.workers) as pool:
        failures = 0
        for succeeded, message in pool.imap_unordered(render_or_say_why, jobs):
            print(message, file=sys.stdout if succeeded else sys.stderr, flush=True)
            failures += not succeeded
    if failures:
        sys.exit(f"{failures} of {len(jobs)} scenes failed")


if __name__ == "__main__":
    main()
