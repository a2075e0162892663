#!/usr/bin/env python3
"""Makes the meshes of these scenes: surfaces of revolution about the y axis, with smooth normals where the profile is smooth.

    python3 scenes/meshes/make.py
"""

import math
import pathlib
import struct

FOLDER = pathlib.Path(__file__).resolve().parent


def revolve(name, profiles, around):
    """Writes `name`.ply. A profile is a list of (radius, height, normal_r, normal_h), walked so that the outside is to its right."""
    vertices, faces = [], []
    for profile in profiles:
        first, n = len(vertices), len(profile)
        for i in range(around):
            angle = 2.0 * math.pi * i / around
            c, s = math.cos(angle), math.sin(angle)
            vertices += [(r * c, h, r * s, nr * c, nh, nr * s) for r, h, nr, nh in profile]
        for i in range(around):
            here, there = first + i * n, first + (i + 1) % around * n
            for k in range(n - 1):
                a, b, c, d = here + k, here + k + 1, there + k + 1, there + k
                # On the axis a quad is a triangle.
                if profile[k + 1][0] > 0.0:
                    faces.append((a, b, c))
                if profile[k][0] > 0.0:
                    faces.append((a, c, d))
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {p}" for p in ("x", "y", "z", "nx", "ny", "nz")]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    data = "\n".join(header).encode()
    data += b"".join(struct.pack("<6f", *v) for v in vertices)
    data += b"".join(struct.pack("<B3i", 3, *f) for f in faces)
    (FOLDER / f"{name}.ply").write_bytes(data)


def circle(center, radius, n):
    """A full turn around (center, 0)."""
    angles = [2.0 * math.pi * i / n for i in range(n + 1)]
    return [(center + radius * math.cos(a), radius * math.sin(a), math.cos(a), math.sin(a)) for a in angles]


def torus():
    """Radii 0.5 and 0.2."""
    revolve("torus", [circle(0.5, 0.2, 32)], 64)


def ring():
    """A finger ring standing on y = 0: walls of radius 1 and 0.94, height 0.5, and flat rims."""
    inner, outer, height = 0.94, 1.0, 0.5
    walls = [
        [(outer, 0.0, 1.0, 0.0), (outer, height, 1.0, 0.0)],
        [(outer, height, 0.0, 1.0), (inner, height, 0.0, 1.0)],
        [(inner, height, -1.0, 0.0), (inner, 0.0, -1.0, 0.0)],
        [(inner, 0.0, 0.0, -1.0), (outer, 0.0, 0.0, -1.0)],
    ]
    revolve("ring", walls, 256)


def lens():
    """Biconvex, radius 1, each side a cap of a sphere of radius 8: of glass, a focal length of 8."""
    sphere, n = 8.0, 24
    apex = math.sqrt(sphere * sphere - 1.0)
    edge = math.asin(1.0 / sphere)
    angles = [edge * i / n for i in range(n + 1)]
    top = [(sphere * math.sin(a), sphere * math.cos(a) - apex, math.sin(a), math.cos(a)) for a in angles]
    upper = [(r if i else 0.0, h, nr, nh) for i, (r, h, nr, nh) in enumerate(top)][::-1]
    lower = [(r, -h, nr, -nh) for r, h, nr, nh in upper][::-1]
    revolve("lens", [lower, upper], 96)


torus()
ring()
lens()
