#!/usr/bin/env python3
"""Whether `render --error` is honest: over many seeds and five scenes, in how many runs the true relMSE is below the target.

    python3 tests/bench/target_error.py 100 0.02 REFERENCES

renders each scene at 96x96 to a relMSE of 0.02 with 100 seeds, and compares with a reference in the folder REFERENCES, which is made if it is not there, with 30 times the samples
of a run by another seed; its own error, 1/30 of the target, adds to all. The bound is stated for 95 % of the runs.
Prints the share of runs whose true error is below the target and below their own upper bound, and the mean ratio of the estimate to the true error.
"""

import json
import pathlib
import statistics
import subprocess
import sys
import tempfile

PROJECT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = PROJECT / "target/release/helmholtz"
SIZE = "96x96"
SCENES = [
    ("cornell-box", "path:max_depth=8"),
    ("open-world", "path:max_depth=8"),
    ("hidden-lamps", "bdpt:max_depth=12"),
    ("ring", "bdpt:max_depth=8"),
    ("lens", "path:max_depth=10"),
]


def render(scene, integrator, image, *extra):
    command = [PROGRAM, "render", PROJECT / f"scenes/{scene}.xml", "--size", SIZE, "--integrator", integrator, "--quiet", "--json", "-o", image, *extra]
    return json.loads(subprocess.run(command, check=True, capture_output=True).stdout)


def true_error(reference, image):
    done = subprocess.run([PROGRAM, "diff", reference, image, "--json"], check=True, capture_output=True)
    return json.loads(done.stdout)[0]["relmse"]


def main():
    seeds, target, references = int(sys.argv[1]), float(sys.argv[2]), pathlib.Path(sys.argv[3])
    references.mkdir(parents=True, exist_ok=True)
    for scene, integrator in SCENES:
        reference = references / f"{scene}.exr"
        with tempfile.TemporaryDirectory() as folder:
            image = pathlib.Path(folder) / "image.exr"
            below, bounded, ratios, passes = 0, 0, [], []
            for seed in range(seeds):
                report = render(scene, integrator, image, "--error", str(target), "--seed", str(seed))
                if not reference.exists():
                    render(scene, integrator, reference, "--spp", str(30 * report["passes"]), "--seed", "99999")
                error = true_error(reference, image)
                below += error < target
                bounded += error < report["relmse_upper"]
                ratios.append(report["relmse_estimate"] / error)
                passes.append(report["passes"])
        print(f"{scene:14} {integrator:20} samples {statistics.median(passes):6.0f}, true error below the target in {below} of {seeds}, "
              f"below the bound in {bounded}; estimate over true error {statistics.mean(ratios):.3f}", flush=True)


if __name__ == "__main__":
    main()
