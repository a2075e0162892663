#!/usr/bin/env python3
"""Error at equal time of photon maps and virtual point lights beside `path` and `bdpt`, on three scenes, as the table of vendor-notes/measurements.md.

    .venv/bin/python tests/bench/two_pass.py REFERENCES 20
    .venv/bin/python tests/bench/two_pass.py REFERENCES 20 --scenes torus-in-glass --mitsuba llvm_ad_rgb

REFERENCES is a folder in which references are kept from run to run; those that are missing are rendered first, for 60 times the time. The Cornell box's is by
`bdpt`, which is unbiased. In the other scenes much is seen through glass that no unbiased integrator here finds: theirs is by `sppm`, whose own error
is estimated from the difference of two halves with independent seeds and printed; it tells noise, not the bias that is left.

Prints relMSE, mean of (I - R)^2 / (R^2 + 0.01) without a border of 4 pixels, the median of three runs with different seeds; `-` stands for an integrator that this
build does not know. Then what issues ask for: `sppm` over Mitsuba's `path` on torus-in-glass (--mitsuba VARIANT; needs DRJIT_LIBLLVM_PATH), and
caustic mode over `path` on glass-spheres. Run it on an idle machine.
"""

import argparse
import math
import pathlib
import re
import statistics
import subprocess

from integrators import PROJECT, mitsubas, ours, reference, rel_mse

SIZE = (256, 256)
# Scene, depth, integrator of the reference. `glass-spheres` has a small lamp here instead of its point light, whose caustics `path` would miss
# altogether.
SCENES = {
    "cornell-box": (8, "bdpt"),
    "glass-spheres": (10, "sppm:mode=caustic,photons=400000"),
    "torus-in-glass": (16, "sppm:photons=400000"),
}
LAMP_RADIUS = 0.05
REFERENCE_TIMES = 60
CAUSTIC, PROGRESSIVE = "photonmapper:mode=caustic", "sppm"
CONFIGURATIONS = [
    "path",
    "bdpt",
    "photonmapper",
    "photonmapper:filter=cone",
    "photonmapper:filter=gaussian",
    "photonmapper:radius=0.01",
    "photonmapper:radius=0.1",
    "photonmapper:lookup=knn,k=20",
    "photonmapper:lookup=knn,k=100",
    "photonmapper:lookup=knn,k=500",
    "photonmapper:direct=nee",
    "photonmapper:direct=nee,final_gather=4",
    CAUSTIC,
    PROGRESSIVE,
    "sppm:direct=nee",
    "sppm:mode=caustic",
    "vpl:count=1000,visibility=none",
    "vpl:count=1000,visibility=rays",
    "vpl:count=1000,visibility=shadowmap",
    "vpl:count=1000,visibility=rays,clamp=1",
    "vpl:count=1000,visibility=rays,clamp=1,compensate=true",
]


def with_lamp(folder):
    """glass-spheres with a sphere of the same intensity in the place of the point light, as a file in `folder`."""
    text = (PROJECT / "scenes/glass-spheres.xml").read_text()
    found = re.search(r'<emitter type="point">\s*<point name="position"([^>]*)/>\s*<rgb name="intensity" value="([^"]*)"/>\s*</emitter>', text)
    radiance = ", ".join(str(float(v) / (math.pi * LAMP_RADIUS**2)) for v in found[2].split(","))
    lamp = f"""<shape type="sphere"><point name="center"{found[1]}/><float name="radius" value="{LAMP_RADIUS}"/>
        <emitter type="area"><rgb name="radiance" value="{radiance}"/></emitter></shape>"""
    path = folder / "glass-spheres-lamp.xml"
    path.write_text(text.replace(found[0], lamp))
    return path


def error(path, depth, integrator, seconds, runs, expected):
    """Median relMSE at `seconds`; `None` if there is no such integrator. A pass too many or too few is scaled away as noise would be."""
    found = []
    for run in range(runs):
        if integrator.startswith("mitsuba:"):
            _, variant, plugin = integrator.split(":")
            image, _, elapsed = mitsubas(path, variant, plugin, seconds, SIZE, 10 + run, depth)
        else:
            try:
                image, _, elapsed = ours(path, integrator, seconds, SIZE, 10 + run, depth)
            except subprocess.CalledProcessError as failure:
                if b"is not known" not in failure.stderr:
                    raise RuntimeError(failure.stderr.decode()) from failure
                return None
        found.append(rel_mse(image, expected) * elapsed / seconds)
    return statistics.median(found)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("references", type=pathlib.Path)
    parser.add_argument("seconds", type=float)
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), default=list(SCENES))
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--only", nargs="+", metavar="INTEGRATOR", default=CONFIGURATIONS)
    parser.add_argument("--mitsuba", metavar="VARIANT")
    arguments = parser.parse_args()
    arguments.references.mkdir(parents=True, exist_ok=True)
    expected, paths = {}, {}
    for scene in arguments.scenes:
        depth, integrator = SCENES[scene]
        paths[scene] = with_lamp(arguments.references) if scene == "glass-spheres" else PROJECT / f"scenes/{scene}.xml"
        seconds = REFERENCE_TIMES * arguments.seconds / 2
        expected[scene] = reference(arguments.references, paths[scene], integrator, seconds, SIZE, depth)
    configurations = arguments.only + ([f"mitsuba:{arguments.mitsuba}:path"] if arguments.mitsuba else [])
    table = {}
    print("\n| | " + " | ".join(expected) + " |\n|---" + "|---" * len(expected) + "|")
    for integrator in configurations:
        for scene, image in expected.items():
            table[integrator, scene] = error(paths[scene], SCENES[scene][0], integrator, arguments.seconds, arguments.runs, image)
        cells = [table[integrator, scene] for scene in expected]
        print(f"| `{integrator}` | " + " | ".join("-" if cell is None else f"{cell:.3g}" for cell in cells) + " |", flush=True)

    def ratio(scene, ours_name, other, aim):
        if (ours_name, scene) in table and (other, scene) in table:
            value = table[ours_name, scene] / table[other, scene]
            print(f"{scene}: {ours_name} over {other} {value:.3g} (the aim is {aim})")

    print()
    ratio("torus-in-glass", PROGRESSIVE, f"mitsuba:{arguments.mitsuba}:path", "1/4")
    ratio("glass-spheres", CAUSTIC, "path", "1/10")


if __name__ == "__main__":
    main()
