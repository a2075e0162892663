#!/usr/bin/env python3
"""Error and samples per second at equal time on the Cornell box: Helmholtz's `bdpt` against LuxCore's BIDIRCPU, run in turns on one machine.

    .venv/bin/pip install pyluxcore
    .venv/bin/python tests/bench/luxcore.py 20 REFERENCE.exr

REFERENCE is a long render of the same scene without a limit on depth and with another seed, for instance
    target/release/helmholtz render scenes/cornell-box.xml --size 256x256 --integrator bdpt --spp 400 --seed 999 -o REFERENCE.exr
LuxCore's Russian roulette is off, as it biases the weights of its strategies by several percent; in its place both of its subpaths have at most
LUX_DEPTH vertices. Units differ, so its image is scaled to the mean of the reference; relMSE is the mean of (I - R)^2 / (R^2 + 0.01) without the
border of 4 pixels.
"""

import os
import sys
import time

import mitsuba as mi
import numpy as np

from integrators import BORDER, PROJECT, load, ours, rel_mse

LUX_DEPTH = 10
CUBE = [
    ((-1, -1, -1), (-1, 1, -1), (1, 1, -1), (1, -1, -1)),
    ((-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)),
    ((-1, -1, -1), (1, -1, -1), (1, -1, 1), (-1, -1, 1)),
    ((-1, 1, -1), (-1, 1, 1), (1, 1, 1), (1, 1, -1)),
    ((-1, -1, -1), (-1, -1, 1), (-1, 1, 1), (-1, 1, -1)),
    ((1, -1, -1), (1, 1, -1), (1, 1, 1), (1, -1, 1)),
]
RECTANGLE = [((-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0))]


def lux_scene(pyluxcore, width, height):
    """The box of mi.cornell_box() in LuxCore's words."""
    description = mi.cornell_box()
    scene, lines = pyluxcore.Scene(), []
    # LuxCore's field of view is that of the shorter side, too. Its camera sees the scene unmirrored, as Mitsuba's does.
    lines += ["scene.camera.type = perspective", "scene.camera.lookat.orig = 0 0 3.9", "scene.camera.lookat.target = 0 0 0"]
    lines += ["scene.camera.up = 0 1 0", f"scene.camera.fieldofview = {description['sensor']['fov']}"]
    for name in ("white", "green", "red"):
        rgb = " ".join(str(v) for v in description[name]["reflectance"]["value"])
        lines += [f"scene.materials.{name}.type = matte", f"scene.materials.{name}.kd = {rgb}"]
    rgb = " ".join(str(v) for v in description["light"]["emitter"]["radiance"]["value"])
    lines += ["scene.materials.lamp.type = matte", "scene.materials.lamp.kd = " + " ".join(str(v) for v in description["white"]["reflectance"]["value"])]
    lines += [f"scene.materials.lamp.emission = {rgb}", "scene.materials.lamp.emission.gain.normalizebycolor = 0"]
    for name, shape in description.items():
        if not isinstance(shape, dict) or shape["type"] not in ("rectangle", "cube"):
            continue
        points, triangles = [], []
        for quad in CUBE if shape["type"] == "cube" else RECTANGLE:
            first = len(points)
            points += [tuple(float(v) for v in shape["to_world"] @ mi.ScalarPoint3f(*corner)) for corner in quad]
            triangles += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
        scene.DefineMesh(f"mesh-{name}", points, triangles, None, None, None, None)
        material = "lamp" if "emitter" in shape else shape["bsdf"]["id"]
        lines += [f"scene.objects.{name}.shape = mesh-{name}", f"scene.objects.{name}.material = {material}"]
    properties = pyluxcore.Properties()
    properties.SetFromString("\n".join(lines))
    scene.Parse(properties)
    config = pyluxcore.Properties()
    config.SetFromString(
        f"""
        renderengine.type = BIDIRCPU
        sampler.type = SOBOL
        film.width = {width}
        film.height = {height}
        film.filter.type = GAUSSIAN
        film.filter.width = 2
        film.imagepipelines.0.0.type = NOP
        film.outputs.0.type = RGB_IMAGEPIPELINE
        film.outputs.0.filename = unused.exr
        path.maxdepth = {LUX_DEPTH}
        light.maxdepth = {LUX_DEPTH}
        path.russianroulette.depth = 1000
        light.russianroulette.depth = 1000
        """
    )
    return pyluxcore.RenderConfig(config, scene)


def render_lux(pyluxcore, seconds, width, height):
    session = pyluxcore.RenderSession(lux_scene(pyluxcore, width, height))
    session.Start()
    start = time.time()
    while time.time() - start < seconds:
        time.sleep(0.05)
    session.UpdateStats()
    samples = session.GetStats().Get("stats.renderengine.total.samplecount").GetFloat()
    elapsed = time.time() - start
    session.Stop()
    image = np.zeros(width * height * 3, dtype=np.float32)
    session.GetFilm().GetOutputFloat(pyluxcore.FilmOutputType.RGB_IMAGEPIPELINE, image, 0, True)
    return image.reshape(height, width, 3)[::-1].astype(np.float64), samples, elapsed


def main():
    import pyluxcore

    seconds, reference = float(sys.argv[1]), load(sys.argv[2])
    pyluxcore.Init(lambda message: None)
    height, width = reference.shape[:2]
    inner = (slice(BORDER, -BORDER), slice(BORDER, -BORDER))
    for run in range(3):
        image, passes, elapsed = ours(PROJECT / "scenes/cornell-box.xml", "bdpt", seconds, (width, height), 100 + run, -1)
        print(f"helmholtz bdpt {passes * width * height / elapsed / 1e6:.3f} M samples/s, relMSE {rel_mse(image, reference):.6f}")
        lux, samples, elapsed = render_lux(pyluxcore, seconds, width, height)
        scale = reference[inner].mean() / lux[inner].mean()
        error = rel_mse(lux * scale, reference)
        print(f"BIDIRCPU {samples / elapsed / 1e6:.3f} M samples/s, relMSE {error:.6f} (scaled by {scale:.4f})", flush=True)


if __name__ == "__main__":
    main()
    # LuxCore's threads crash the interpreter as it ends.
    sys.stdout.flush()
    os._exit(0)
