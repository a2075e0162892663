#!/usr/bin/env python3
"""The table from which the backends' default settings follow: build time, memory and rays per second of each choice, beside Embree as it is by default.

    tests/bench/backends.py SCENE [--rays N] [--size WxH] [--runs N] [--helmholtz PROGRAM]

Every row is `helmholtz ab` of the default against one other choice, which answer the same rays in turns; rates are ratios to the
default of the same run, medians over the runs, since machines are noisy. For an idle machine. Nothing but Python is needed.
"""

import argparse
import json
import statistics
import subprocess

CHOICES = [
    "embree:robust=true,quality=low",
    "embree:robust=true,quality=medium",
    "embree:robust=true,quality=high",
    "embree:robust=true,compact=true",
    "embree:robust=false,quality=low",
    "embree:robust=false,quality=medium",
    "embree:robust=false,quality=high",
    "embree:robust=false,compact=true",
    "obvhs:quality=low",
    "obvhs:quality=medium",
    "obvhs:quality=high",
]
KINDS = ["primary", "bounce", "shadow"]


def compare(arguments, choice):
    command = [arguments.helmholtz, "ab", arguments.scene, "--a", "embree", "--b", choice, "--spp", "1", "--json",
               "--rays", str(arguments.rays), "--size", arguments.size, "--lenient"]
    process = subprocess.run(command, capture_output=True, text=True)
    # 4 says that there are faults, which fast mode has.
    if process.returncode not in (0, 4):
        raise SystemExit(f"{' '.join(command)}: {process.stderr}")
    return json.loads(process.stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--rays", type=int, default=4_000_000)
    parser.add_argument("--size", default="512x512")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--helmholtz", default="target/release/helmholtz")
    arguments = parser.parse_args()
    print("| choice | build, s | bytes per primitive | primary | bounce | shadow | faults | ties |")
    print("|---|---|---|---|---|---|---|---|")
    for choice in CHOICES:
        runs = [compare(arguments, choice) for _ in range(arguments.runs)]
        of_b = [run["backends"][1] for run in runs]
        ratios = [statistics.median(run["backends"][1]["rays_per_second"][kind] / run["backends"][0]["rays_per_second"][kind]
                                    for run in runs) for kind in KINDS]
        build = statistics.median(b["build_seconds"] for b in of_b)
        found = [runs[0]["rays"][kind] for kind in KINDS]
        faults = sum(rays["faults"] for rays in found)
        more = sum(rays["not_judged"] for rays in found)
        rates = " | ".join(f"{ratio:.2f}" for ratio in ratios)
        suspects = f" (and {more} not judged)" if more else ""
        print(f"| `{choice}` | {build:.2f} | {of_b[0]['bytes_per_primitive']:.0f} | {rates} | {faults}{suspects} | "
              f"{sum(rays['ties'] for rays in found)} |", flush=True)


if __name__ == "__main__":
    main()
