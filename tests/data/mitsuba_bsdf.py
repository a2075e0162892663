"""Writes mitsuba_bsdf.txt: values of Mitsuba's BSDFs, which tests/bsdf compares ours with.

Needs `pip install mitsuba`; run as `python mitsuba_bsdf.py > mitsuba_bsdf.txt`. The materials are those of `mitsuba_material` in tests/bsdf/mod.rs.
"""
import math

import mitsuba as mi

mi.set_variant("scalar_rgb")


def rgb(*values):
    return {"type": "rgb", "value": list(values)}


GOLD = {"eta": rgb(0.143, 0.375, 1.442), "k": rgb(3.983, 2.386, 1.603)}
OPAQUE = {
    "diffuse": {"type": "diffuse", "reflectance": rgb(0.2, 0.5, 0.8)},
    "ggx_gold": {"type": "roughconductor", "distribution": "ggx", "alpha": 0.3, **GOLD},
    "ggx_gold_anisotropic": {
        "type": "roughconductor", "distribution": "ggx", "alpha_u": 0.05, "alpha_v": 0.4, **GOLD,
        "specular_reflectance": rgb(0.9, 0.8, 0.7),
    },
    "beckmann_gold": {"type": "roughconductor", "distribution": "beckmann", "alpha": 0.2, **GOLD},
    "plastic": {"type": "plastic", "diffuse_reflectance": rgb(0.9, 0.3, 0.1), "int_ior": 1.9, "ext_ior": 1.0},
    "plastic_nonlinear": {
        "type": "plastic", "diffuse_reflectance": rgb(0.9, 0.3, 0.1), "specular_reflectance": rgb(0.5, 0.5, 0.5),
        "int_ior": 1.5, "ext_ior": 1.0, "nonlinear": True,
    },
    "ggx_plastic": {
        "type": "roughplastic", "distribution": "ggx", "alpha": 0.3, "diffuse_reflectance": rgb(0.9, 0.3, 0.1), "int_ior": 1.9,
        "ext_ior": 1.0, "nonlinear": True,
    },
    "beckmann_plastic": {
        "type": "roughplastic", "distribution": "beckmann", "alpha": 0.1, "diffuse_reflectance": rgb(0.2, 0.3, 0.8), "int_ior": 1.5,
        "ext_ior": 1.0,
    },
    "principled_plain": {"type": "principled", "base_color": rgb(0.8, 0.3, 0.1), "roughness": 0.6, "eta": 1.5},
    "principled_metal": {
        "type": "principled", "base_color": rgb(0.9, 0.6, 0.2), "metallic": 0.8, "roughness": 0.5, "anisotropic": 0.7,
        "spec_tint": 0.5, "eta": 1.6,
    },
    "principled_cloth": {
        "type": "principled", "base_color": rgb(0.2, 0.3, 0.8), "sheen": 0.8, "sheen_tint": 0.6, "flatness": 0.5, "clearcoat": 0.9,
        "clearcoat_gloss": 0.2, "roughness": 0.8, "eta": 1.4,
    },
    "blend": {
        "type": "blendbsdf", "weight": 0.3, "first": {"type": "diffuse", "reflectance": rgb(0.2, 0.5, 0.8)},
        "second": {"type": "roughconductor", "distribution": "ggx", "alpha": 0.3, **GOLD},
    },
    "mask": {"type": "mask", "opacity": 0.7, "nested": {"type": "diffuse", "reflectance": rgb(0.2, 0.5, 0.8)}},
    "normalmap": {
        "type": "normalmap", "normalmap": rgb(0.7, 0.4, 0.9), "nested": {"type": "diffuse", "reflectance": rgb(0.2, 0.5, 0.8)},
    },
    "normalmap_steep": {
        "type": "normalmap", "normalmap": rgb(0.95, 0.4, 0.6), "use_shadowing_function": False,
        "nested": {"type": "roughconductor", "distribution": "ggx", "alpha": 0.5, **GOLD},
    },
}
TRANSMITTING = {
    "ggx_glass": {"type": "roughdielectric", "distribution": "ggx", "alpha": 0.2, "int_ior": 1.5, "ext_ior": 1.0},
    "ggx_water_anisotropic": {
        "type": "roughdielectric", "distribution": "ggx", "alpha_u": 0.1, "alpha_v": 0.5, "int_ior": 1.33, "ext_ior": 1.0,
        "specular_reflectance": rgb(0.9, 0.8, 0.7), "specular_transmittance": rgb(0.3, 0.6, 0.9),
    },
    "ggx_bubble": {"type": "roughdielectric", "distribution": "ggx", "alpha": 0.4, "int_ior": 1.0, "ext_ior": 1.8},
    "principled_glass": {
        "type": "principled", "base_color": rgb(0.9, 0.5, 0.3), "spec_trans": 0.8, "metallic": 0.3, "spec_tint": 0.7, "roughness": 0.6,
        "eta": 1.3,
    },
    "beckmann_glass": {"type": "roughdielectric", "distribution": "beckmann", "alpha": 0.3, "int_ior": 1.5, "ext_ior": 1.0},
}
# Polar and azimuthal angles of wo and wi in degrees; Mitsuba calls them wi and wo.
REFLECTIONS = [(20, 30, 25, 200), (60, 10, 55, 195), (85, 100, 70, 280), (45, 0, 45, 90), (88, 20, 80, 170)]
BOTH_SIDES = [
    (20, 30, 25, 200), (75, 10, 70, 195), (30, 30, 160, 205), (60, 100, 140, 285),
    (10, 0, 175, 60), (150, 30, 160, 220), (155, 30, 30, 200), (170, 0, 12, 40),
]  # fmt: skip


def direction(theta, phi):
    t, p = math.radians(theta), math.radians(phi)
    return mi.Vector3f(math.sin(t) * math.cos(p), math.sin(t) * math.sin(p), math.cos(t))


def write(name, material, cases):
    bsdf = mi.load_dict(material)
    for case in cases:
        for mode in ["Radiance", "Importance"]:
            context = mi.BSDFContext(getattr(mi.TransportMode, mode))
            interaction = mi.SurfaceInteraction3f()
            interaction.wi = direction(*case[:2])
            wo = direction(*case[2:])
            values = [*bsdf.eval(context, interaction, wo), bsdf.pdf(context, interaction, wo)]
            print(name, mode, *case, *(f"{v:.6e}" for v in values))


print(f"# Mitsuba {mi.__version__}, scalar_rgb. Written by mitsuba_bsdf.py.")
print("# material mode theta_o phi_o theta_i phi_i eval_r eval_g eval_b pdf; eval includes the cosine")
for name, material in OPAQUE.items():
    write(name, material, REFLECTIONS)
for name, material in TRANSMITTING.items():
    write(name, material, BOTH_SIDES)
