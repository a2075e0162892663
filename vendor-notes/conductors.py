#!/usr/bin/env python3
"""Writes src/scene/load/mitsuba/conductors.rs: indices of refraction of metals as RGB.

Source: the measured spectra that Mitsuba 3 ships (mitsuba/data/ior/*.spd), which are those of the Luxpop database and of
Palik, "Handbook of optical constants of solids" (names ending in `_palik`). For each channel the spectrum is integrated against
the CIE 1931 colour matching functions from 360 to 830 nm in steps of 1 nm, divided by the integral of y, and converted from
XYZ to linear Rec. 709; negative values become 0. Beyond its ends a spectrum goes on as it ends. Spectra that end
before 650 nm say nothing of red, and are left out.

Needs `pip install mitsuba numpy`. Usage: conductors.py > src/scene/load/mitsuba/conductors.rs
"""
import pathlib

import mitsuba
import numpy

mitsuba.set_variant("scalar_rgb")
FOLDER = pathlib.Path(mitsuba.__file__).parent / "data" / "ior"
WAVELENGTHS = numpy.arange(360.0, 831.0)
CIE = numpy.array([list(mitsuba.cie1931_xyz(float(w))) for w in WAVELENGTHS], dtype=float)
TO_RGB = numpy.array([[3.240479, -1.537150, -0.498535], [-0.969256, 1.875991, 0.041556], [0.055648, -0.204043, 1.057311]])


def spectrum(path):
    rows = [line.split("#")[0].split() for line in path.read_text().splitlines()]
    return numpy.array([[float(x) for x in row[:2]] for row in rows if len(row) >= 2])


def rgb(path):
    data = spectrum(path)
    values = numpy.interp(WAVELENGTHS, data[:, 0], data[:, 1])
    xyz = (CIE * values[:, None]).sum(axis=0) / CIE[:, 1].sum()
    return numpy.maximum(TO_RGB @ xyz, 0.0)


def text(color):
    return "[" + ", ".join(f"{x:.5f}".rstrip("0") + ("0" if f"{x:.5f}".rstrip("0").endswith(".") else "") for x in color) + "]"


print("//! Indices of refraction of metals and semiconductors, by the names that Mitsuba gives them.")
print("//!")
print("//! Written by `vendor-notes/conductors.py`, which says where the numbers come from.")
print()
print("/// Name, real and imaginary part in linear Rec. 709.")
print("#[rustfmt::skip]")
print("pub(super) const CONDUCTORS: &[(&str, [f32; 3], [f32; 3])] = &[")
for path in sorted(FOLDER.glob("*.eta.spd")):
    name = path.name.removesuffix(".eta.spd")
    other = FOLDER / f"{name}.k.spd"
    if min(spectrum(path)[-1, 0], spectrum(other)[-1, 0]) >= 650.0:
        print(f'    ("{name}", {text(rgb(path))}, {text(rgb(other))}),')
print("];")
