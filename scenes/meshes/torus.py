#!/usr/bin/env python3
"""Makes torus.obj: the torus of radii 1 and 0.4 around the z axis, 64 x 32 quads with exact normals.

    python3 scenes/meshes/torus.py > scenes/meshes/torus.obj
"""

from math import cos, pi, sin

N, M, R, r = 64, 32, 1.0, 0.4
for i in range(N):
    for j in range(M):
        u, v = 2 * pi * i / N, 2 * pi * j / M
        print(f"v {(R + r * cos(v)) * cos(u):.6f} {(R + r * cos(v)) * sin(u):.6f} {r * sin(v):.6f}")
        print(f"vn {cos(v) * cos(u):.6f} {cos(v) * sin(u):.6f} {sin(v):.6f}")
for i in range(N):
    for j in range(M):
        corners = [(i, j), ((i + 1) % N, j), ((i + 1) % N, (j + 1) % M), (i, (j + 1) % M)]
        print("f " + " ".join(f"{a * M + b + 1}//{a * M + b + 1}" for a, b in corners))
