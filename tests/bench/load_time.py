#!/usr/bin/env python3
"""How long a scene takes to load, beside Mitsuba's `load_file` in `scalar_rgb`.

    .venv/bin/python tests/bench/load_time.py ../shared/testdata/scenes/country-kitchen/kitchen_v3.xml 7

loads it in turns, 7 times each after one that warms the file cache, and prints the medians and that of the ratios of pairs. Mitsuba's time
includes its acceleration structure, so ours is given with and without building it. Ours is what `render --json` reports: no start of a process,
as no import is counted of Mitsuba's. Both use all threads.
"""

import json
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import mitsuba as mi

mi.set_variant("scalar_rgb")

PROJECT = pathlib.Path(__file__).resolve().parents[2]


def ours(scene):
    with tempfile.TemporaryDirectory() as folder:
        command = [PROJECT / "target/release/helmholtz", "render", scene, "--spp", "1", "--size", "8x8", "--quiet", "--json", "--lenient"]
        output = subprocess.run([*command, "-o", f"{folder}/image.exr"], check=True, capture_output=True).stdout
        report = json.loads(output)
        return report["load_seconds"], report["load_seconds"] + report["build_seconds"]


def theirs(scene):
    start = time.perf_counter()
    loaded = mi.load_file(scene)
    seconds = time.perf_counter() - start
    del loaded
    return seconds


def main():
    scene, runs = sys.argv[1], int(sys.argv[2])
    ours(scene), theirs(scene)
    rows = [(*ours(scene), theirs(scene)) for _ in range(runs)]
    loading, with_building, mitsuba = (statistics.median(column) for column in zip(*rows))
    print(f"helmholtz: {loading:.3f} s, and building {with_building:.3f} s; mitsuba: {mitsuba:.3f} s")
    print(f"ratio of loading {statistics.median(r[0] / r[2] for r in rows):.2f}, with building {statistics.median(r[1] / r[2] for r in rows):.2f}")


if __name__ == "__main__":
    main()
