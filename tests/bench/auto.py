#!/usr/bin/env python3
"""The error of `--integrator auto` at equal time, beside that of every integrator, over scenes/ and ../shared/testdata.

    python3 tests/bench/auto.py 20 REFERENCES [SCENE...]

renders each scene for 20 s by each integrator, 256x256, and compares with a reference in the folder REFERENCES, which is made if it is not there
(20 times as long, another seed, by the integrator named below; the reference's own error adds to all). The time that `auto` takes to choose is taken from its 20 s. Prints relMSE,
plain and trimmed (without the worst 0.1 %), the median of three seeds, and how many times that of the best integrator the error of `auto` is, by the trimmed one: single bright specks of
`path` would decide otherwise. Run it while nothing else runs.
"""

import json
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile

PROJECT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = PROJECT / "target/release/helmholtz"
DATA = PROJECT.parent / "shared/testdata/scenes"
SIZE = "256x256"
SEEDS = (10, 11, 12)
INTEGRATORS = ["path", "ptracer", "bdpt", "photonmapper", "photonmapper:mode=caustic", "sppm", "sppm:mode=caustic", "vpl"]

# Scene, max_depth, and what makes the reference: an integrator that finds all light there.
SCENES = {
    "cornell-box": (PROJECT / "scenes/cornell-box.xml", 8, "path"),
    "ring": (PROJECT / "scenes/ring.xml", 8, "bdpt"),
    "torus-in-glass": (PROJECT / "scenes/torus-in-glass.xml", 16, "sppm:mode=caustic"),
    "glass-spheres": (PROJECT / "scenes/glass-spheres.xml", 10, "sppm:mode=caustic"),
    "hidden-lamps": (PROJECT / "scenes/hidden-lamps.xml", 12, "bdpt"),
    "lens": (PROJECT / "scenes/lens.xml", 10, "path"),
    "open-world": (PROJECT / "scenes/open-world.xml", 8, "path"),
    "cbox": (DATA / "cbox/cbox_v3.xml", 8, "path"),
    "sms-ring": (DATA / "sms-ring/ring_v3.xml", 8, "bdpt"),
    "torus": (DATA / "torus/torus_v3.xml", 12, "sppm:mode=caustic"),
    "sponza": (DATA / "sponza/sponza_v3.xml", 6, "path"),
    "veach-bidir": (DATA / "veach-bidir/scene.xml", 12, "bdpt"),
    "kitchen": (DATA / "country-kitchen/kitchen_v3.xml", 8, "path"),
}


def render(scene, integrator, depth, seed, seconds, image):
    """Renders; what was said, and the statistics."""
    integrator += f"{',' if ':' in integrator else ':'}max_depth={depth}"
    command = [PROGRAM, "render", scene, "--size", SIZE, "--time", f"{seconds}s", "--seed", str(seed), "--integrator", integrator, "--json", "-o", image]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return done.stderr, json.loads(done.stdout)


def choice(scene, depth, image):
    """The reason that `auto` gives, and how long it takes."""
    said, report = render(scene, "auto", depth, 1, 0.001, image)
    reason = re.search(r"auto takes (.*) \(([0-9.]+) s\)", said)
    return report["integrator"], reason[1], float(reason[2])


def errors(reference, image):
    done = subprocess.run([PROGRAM, "diff", reference, image, "--json"], check=True, capture_output=True, text=True)
    comparison = json.loads(done.stdout)[0]
    return comparison["relmse"], comparison["relmse_trimmed"]


def main():
    seconds, references = float(sys.argv[1]), pathlib.Path(sys.argv[2])
    references.mkdir(parents=True, exist_ok=True)
    for name in sys.argv[3:] or SCENES:
        scene, depth, best = SCENES[name]
        reference = references / f"{name}.exr"
        if not reference.exists():
            render(scene, best, depth, 999, 20 * seconds, reference)
        found = {}
        with tempfile.TemporaryDirectory() as folder:
            image = pathlib.Path(folder) / "image.exr"
            _, why, taken = choice(scene, depth, image)
            print(f"{name}: auto takes {why}, in {taken} s")
            for integrator in [*INTEGRATORS, "auto"]:
                time = max(seconds - taken, 0.01) if integrator == "auto" else seconds
                runs = []
                for seed in SEEDS:
                    render(scene, integrator, depth, seed, time, image)
                    runs.append(errors(reference, image))
                found[integrator] = [statistics.median(values) for values in zip(*runs)]
                plain, trimmed = found[integrator]
                print(f"  {integrator:28} relMSE {plain:.5f}, trimmed {trimmed:.5f}", flush=True)
        others = {integrator: trimmed for integrator, (_, trimmed) in found.items() if integrator != "auto"}
        least = min(others, key=others.get)
        print(f"  auto has {found['auto'][1] / others[least]:.2f} times the error of {least}", flush=True)


if __name__ == "__main__":
    main()
