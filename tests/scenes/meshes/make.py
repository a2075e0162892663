#!/usr/bin/env python3
"""Writes the meshes of serialized.xml and mesh-files.xml: the same shapes as Mitsuba 3 reads them, and as only older programs write them.

An arrow-shaped prism (concave faces): arrow.obj in triangles, arrow-odd.obj in groups, polygons, backward indices and continued lines.
A wave with normals and texture coordinates: wave-odd-le.ply and -be.ply in doubles, with properties and elements nobody asked for, and
wave-faces.ply, big-endian, faces first, in quads.
two.serialized: the wave in single precision with normals, and the prism in double precision without.
"""

import math
import pathlib
import struct
import zlib

FOLDER = pathlib.Path(__file__).parent

# The arrow from its notch, counter-clockwise seen from +z, and its triangles.
OUTLINE = [(0, 0.4), (-1, 1), (0, -1), (1, 1)]
CUT = [(0, 1, 2), (0, 2, 3)]
N = len(OUTLINE)


def arrow():
    points = [(x, y, z) for z in (-0.25, 0.25) for x, y in OUTLINE]
    front = [tuple(i + N for i in range(N))]
    back = [tuple(reversed(range(N)))]
    sides = [(i, (i + 1) % N, (i + 1) % N + N, i + N) for i in range(N)]
    return points, front, back, sides


def write_obj():
    points, front, back, sides = arrow()
    vertices = "".join("v %g %g %g\n" % p for p in points)
    triangles = [tuple(i + N for i in t) for t in CUT] + [tuple(reversed(t)) for t in CUT]
    for a, b, c, d in sides:
        triangles += [(a, b, c), (a, c, d)]
    (FOLDER / "arrow.obj").write_text(vertices + "".join("f %d %d %d\n" % tuple(i + 1 for i in t) for t in triangles))
    # Polygons start at the wing, from where a fan would leave the notch filled.
    start = lambda face: face[1:] + face[:1]
    back_first = lambda face: " ".join(str(i - 2 * N) for i in face)
    odd = "mtllib none.mtl\r\no arrow\r\n" + vertices.replace("\n", " 0.5 0.5 0.5\r\n") + "g front ends\r\n"
    odd += "".join("f " + back_first(start(f)) + "\r\n" for f in front + back)
    odd += "g\tsides\nusemtl none\ns 1\nl 1 2 3\n" + "".join("f \\\n " + " ".join(str(i + 1) for i in f) + "\n" for f in sides)
    (FOLDER / "arrow-odd.obj").write_bytes(odd.encode())
    return points, triangles


def wave(n=12):
    vertices, quads = [], []
    for j in range(n + 1):
        for i in range(n + 1):
            u, v = i / n, j / n
            slope = 0.15 * 2 * math.pi * math.cos(2 * math.pi * u)
            normal = (-slope / 2, 1, 0)
            length = math.hypot(*normal)
            vertices.append((2 * u - 1, 0.15 * math.sin(2 * math.pi * u), 1 - 2 * v) + tuple(x / length for x in normal) + (u, v))
    for j in range(n):
        for i in range(n):
            a = j * (n + 1) + i
            quads.append((a, a + 1, a + n + 2, a + n + 1))
    return vertices, quads


def write_ply():
    vertices, quads = wave()
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    for order, name, sign in (("little", "le", "<"), ("big", "be", ">")):
        header = f"ply\nformat binary_{order}_endian 1.0\ncomment odd\nelement vertex {len(vertices)}\n"
        header += "".join(f"property double {p}\n" for p in "xyz") + "property uchar red\nproperty short flags\n"
        header += "".join(f"property double {p}\n" for p in ("nx", "ny", "nz")) + "property float u\nproperty float v\n"
        header += f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
        body = b"".join(struct.pack(sign + "3dBh3d2f", *v[:3], 7, -3, *v[3:]) for v in vertices)
        body += b"".join(struct.pack(sign + "B3i", 3, *t) for t in triangles)
        (FOLDER / f"wave-odd-{name}.ply").write_bytes(header.encode() + body)
    header = f"ply\nformat binary_big_endian 1.0\nelement face {len(quads)}\nproperty ushort group\nproperty list ushort ushort vertex_index\n"
    header += f"element vertex {len(vertices)}\n" + "".join(f"property float {p}\n" for p in ("x", "y", "z", "nx", "ny", "nz", "s", "t"))
    header += "property list uchar float weights\nelement edge 2\nproperty int a\nproperty list uint uchar b\nend_header\n"
    body = b"".join(struct.pack(">HH4H", 9, 4, *q) for q in quads)
    body += b"".join(struct.pack(">8fB2f", *v, 2, 0.25, 0.75) for v in vertices) + struct.pack(">iI3BiI", 1, 3, 1, 2, 3, 2, 0)
    (FOLDER / "wave-faces.ply").write_bytes(header.encode() + body)
    return vertices, triangles


def serialized(meshes):
    """meshes: (flags, name, floats of all vertices attribute after attribute, number of vertices, triangles)."""
    out, offsets = b"", []
    for flags, name, numbers, count, triangles in meshes:
        stream = struct.pack("<I", flags) + name.encode() + b"\0" + struct.pack("<QQ", count, len(triangles))
        stream += struct.pack("<%d%s" % (len(numbers), "d" if flags & 0x2000 else "f"), *numbers)
        stream += b"".join(struct.pack("<3I", *t) for t in triangles)
        offsets.append(len(out))
        out += struct.pack("<HH", 0x041C, 4) + zlib.compress(stream)
    return out + b"".join(struct.pack("<Q", o) for o in offsets) + struct.pack("<I", len(meshes))


def main():
    points, arrow_triangles = write_obj()
    vertices, triangles = write_ply()
    numbers = [x for part in (slice(0, 3), slice(3, 6), slice(6, 8)) for v in vertices for x in v[part]]
    meshes = [
        (0x1003, "wave", numbers, len(vertices), triangles),
        (0x2010, "arrow", [x for p in points for x in p], len(points), arrow_triangles),
    ]
    (FOLDER / "two.serialized").write_bytes(serialized(meshes))


if __name__ == "__main__":
    main()
