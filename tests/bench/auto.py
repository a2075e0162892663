#!/usr/bin/env python3
"""The error of `--integrator auto` at equal time, beside that of every integrator, over scenes/ and ../shared/testdata.

    python3 tests/bench/auto.py REFERENCES [--seconds 20] [--shrink 1] [--seeds 3] [SCENE...]

renders each scene for 20 s by each integrator, 256x256, and compares with a reference in the folder REFERENCES, which is made if it is not there
(12 times as long, another seed, by the integrator named below; the reference's own error adds to all). The time that `auto` takes to choose is taken from its 20 s. Prints relMSE,
plain and trimmed (without the worst 0.1 %), the median of the seeds, and how many times that of the best integrator the error of `auto` is, by the trimmed one: single bright specks of
`path` would decide otherwise. `--shrink 4` renders a quarter of the pixels in a quarter of the time: as many samples per pixel, and of `auto` as many as it would have. Run it while nothing else runs.
"""

import argparse
import json
import math
import pathlib
import re
import statistics
import subprocess
import tempfile

PROJECT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = PROJECT / "target/release/helmholtz"
DATA = PROJECT.parent / "shared/testdata/scenes"
SIZE = 256
REFERENCE_TIMES = 12
INTEGRATORS = ["path", "ptracer", "bdpt", "photonmapper", "photonmapper:mode=caustic", "sppm", "sppm:mode=caustic", "vpl"]

# Scene, max_depth, and what makes the reference: an integrator that finds all light there.
SCENES = {
    "cornell-box": (PROJECT / "scenes/cornell-box.xml", 8, "path"),
    "ring": (PROJECT / "scenes/ring.xml", 8, "bdpt"),
    "torus-in-glass": (PROJECT / "scenes/torus-in-glass.xml", 16, "sppm:mode=caustic"),
    "glass-spheres": (PROJECT / "scenes/glass-spheres.xml", 10, "bdpt"),
    "hidden-lamps": (PROJECT / "scenes/hidden-lamps.xml", 12, "bdpt"),
    "lens": (PROJECT / "scenes/lens.xml", 10, "path"),
    "open-world": (PROJECT / "scenes/open-world.xml", 8, "path"),
    "cbox": (DATA / "cbox/cbox_v3.xml", 8, "path"),
    "sms-ring": (DATA / "sms-ring/ring_v3.xml", 8, "bdpt"),
    "torus": (DATA / "torus/torus_v3.xml", 12, "sppm:mode=caustic"),
    "sponza": (DATA / "sponza/sponza_v3.xml", 6, "path"),
    "veach-bidir": (DATA / "veach-bidir/scene.xml", 12, "bdpt"),
    "kitchen": (DATA / "country-kitchen/kitchen_v3.xml", 8, "bdpt"),
}


def render(scene, integrator, depth, seed, seconds, size, image):
    """Renders; what was said, and the statistics."""
    integrator += f"{',' if ':' in integrator else ':'}max_depth={depth}"
    command = [PROGRAM, "render", scene, "--size", f"{size}x{size}", "--time", f"{seconds}s", "--seed", str(seed), "--integrator", integrator, "--json", "-o", image]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return done.stderr, json.loads(done.stdout)


def choice(scene, depth, size, image):
    """The reason that `auto` gives, and how long it takes."""
    said, report = render(scene, "auto", depth, 1, 0.001, size, image)
    reason = re.search(r"auto takes (.*) \(([0-9.]+) s\)", said)
    return report["integrator"], reason[1], float(reason[2])


def errors(reference, image):
    done = subprocess.run([PROGRAM, "diff", reference, image, "--json"], check=True, capture_output=True, text=True)
    comparison = json.loads(done.stdout)[0]
    return comparison["relmse"], comparison["relmse_trimmed"]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("references", type=pathlib.Path)
    parser.add_argument("scenes", nargs="*", default=list(SCENES))
    parser.add_argument("--seconds", type=float, default=20)
    parser.add_argument("--shrink", type=float, default=1)
    parser.add_argument("--seeds", type=int, default=3)
    args = parser.parse_intermixed_args()
    args.references.mkdir(parents=True, exist_ok=True)
    size, seconds = round(SIZE / math.sqrt(args.shrink)), args.seconds / args.shrink
    for name in args.scenes:
        scene, depth, best = SCENES[name]
        reference = args.references / f"{name}-{size}.exr"
        if not reference.exists():
            render(scene, best, depth, 999, REFERENCE_TIMES * seconds, size, reference)
        found = {}
        with tempfile.TemporaryDirectory() as folder:
            image = pathlib.Path(folder) / "image.exr"
            chosen, why, taken = choice(scene, depth, size, image)
            print(f"{name}: auto takes {why}, in {taken} s")
            for integrator in [*INTEGRATORS, "auto"]:
                time = max(args.seconds - taken, 0.01) / args.shrink if integrator == "auto" else seconds
                named = re.sub(r"max_depth=\d+,", "", chosen) if integrator == "auto" else integrator
                runs = []
                for seed in range(10, 10 + args.seeds):
                    render(scene, named, depth, seed, time, size, image)
                    runs.append(errors(reference, image))
                found[integrator] = [statistics.median(values) for values in zip(*runs)]
                plain, trimmed = found[integrator]
                print(f"  {integrator:28} relMSE {plain:.5f}, trimmed {trimmed:.5f}", flush=True)
        others = {integrator: trimmed for integrator, (_, trimmed) in found.items() if integrator != "auto"}
        least = min(others, key=others.get)
        print(f"  auto has {found['auto'][1] / others[least]:.2f} times the error of {least}", flush=True)


if __name__ == "__main__":
    main()
