#!/usr/bin/env python3
"""Renders a .csbrdf file beside the table that it was made from, and says how far the pictures are apart.

    render.py chrome.csbrdf chrome.binary --out pictures
    render.py chrome.csbrdf chrome.binary --second paint.csbrdf paint.binary --out pictures

Scenes: a sphere under an environment light; with --second also two objects, one of each material, on a floor under an area
light. Writes SCENE-csbrdf.png, SCENE-table.png and SCENE-difference.png (tone-mapped difference, fifty times) into the folder,
and prints a line a scene: PSNR of the tone-mapped pictures over the pixels that show the materials, that of two renderings
of the table with different random numbers (what noise alone makes), and seconds.
"""
import argparse
import contextlib
import math
import sys
import time
from pathlib import Path

import mitsuba as mi
import numpy as np


def parse(arguments):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", help="the material as .csbrdf")
    parser.add_argument("table", help="the same as a MERL .binary table (or any .csbrdf to compare with)")
    parser.add_argument("--second", nargs=2, metavar=("FILE", "TABLE"), help="another material, for the scene of two")
    parser.add_argument("--out", type=Path, default=Path("."), help="folder for the pictures")
    parser.add_argument("--size", type=int, default=256, help="pixels along each side (256)")
    parser.add_argument("--spp", type=int, default=256, help="samples a pixel (256)")
    parser.add_argument("--variant", default="llvm_ad_rgb", help="Mitsuba's variant (llvm_ad_rgb)")
    parser.add_argument("--mode", choices=["texture", "blocks"], help="of the csbrdf plugin")
    parser.add_argument("--at-least", type=float, metavar="DB", help="exit 1 if a PSNR is lower")
    return parser.parse_args(arguments)


def environment():
    """A sky, a small sun, a warm and a cold soft box: radiance [elevation, azimuth, rgb]."""
    height, width = 128, 256
    theta, phi = np.meshgrid((np.arange(height) + 0.5) * math.pi / height, (np.arange(width) + 0.5) * 2 * math.pi / width,
                             indexing="ij")
    up = np.cos(theta)[..., None]
    image = np.where(up > 0, 0.25 + np.array([0.1, 0.25, 0.55]) * (0.3 + 0.7 * up), [0.10, 0.09, 0.08])
    direction = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)

    def lamp(elevation, azimuth, radius, colour):
        e, a = math.radians(elevation), math.radians(azimuth)
        towards = np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])
        away = np.degrees(np.arccos(np.clip(direction @ towards, -1, 1)))
        return np.clip((radius + 1 - away) / 2, 0, 1)[..., None] * np.array(colour)

    image = image + lamp(50, 200, 5, (60, 55, 48)) + lamp(20, 60, 16, (4, 2.6, 1.4)) + lamp(10, 300, 14, (1.2, 2.2, 4))
    return image.astype(np.float32)


def camera(size, origin, target, fov):
    return {
        "type": "perspective", "fov": fov, "to_world": mi.ScalarTransform4f().look_at(origin, target, [0, 0, 1]),
        "film": {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}, "pixel_format": "rgb"},
        "sampler": {"type": "independent"},
    }


def sphere(size, materials):
    """The objects that show the materials, and all else."""
    scale = mi.ScalarTransform4f().rotate([1, 0, 0], 90)  # the map's pole upwards
    sky = {"type": "envmap", "bitmap": mi.Bitmap(environment()), "to_world": scale}
    objects = {"sphere": {"type": "sphere", "bsdf": materials[0]}}
    return objects, {"sensor": camera(size, [0, -6, 1.2], [0, 0, 0], 24), "sky": sky}


def pair(size, materials):
    transform = mi.ScalarTransform4f
    floor = {"type": "rectangle", "to_world": transform().scale([12, 12, 1]),
             "bsdf": {"type": "diffuse", "reflectance": {
                 "type": "checkerboard", "to_uv": transform().scale([24, 24, 1]),
                 "color0": {"type": "rgb", "value": 0.35}, "color1": {"type": "rgb", "value": 0.15}}}}
    lamp = {"type": "rectangle", "to_world": transform().look_at([-3, -3, 6], [0, 0, 0], [0, 0, 1]) @ transform().scale(1.1),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [16, 15, 13]}}}
    objects = {
        "ball": {"type": "sphere", "center": [-1.1, 0, 1], "radius": 1, "bsdf": materials[0]},
        "box": {"type": "cube", "bsdf": materials[1],
                "to_world": transform().translate([1.3, 0.3, 0.8]) @ transform().rotate([0, 0, 1], 32) @ transform().scale(0.8)},
    }
    sky = {"type": "constant", "radiance": {"type": "rgb", "value": [0.25, 0.3, 0.38]}}
    return objects, {"sensor": camera(size, [0, -7, 3.6], [0.1, 0, 0.75], 34), "floor": floor, "lamp": lamp, "sky": sky}


def picture(scene, materials, args, seed=0):
    objects, rest = scene(args.size, materials)
    loaded = mi.load_dict({"type": "scene", "integrator": {"type": "path", "max_depth": 5}, **objects, **rest})
    image = mi.render(loaded, spp=args.spp, seed=seed)
    return np.array(image)


def shows_materials(scene, args):
    """The pixels that objects with the materials are in."""
    objects, rest = scene(args.size, [{"type": "diffuse"}] * 2)
    loaded = mi.load_dict({"type": "scene", "integrator": {"type": "depth"}, **objects, "sensor": rest["sensor"]})
    return np.array(mi.render(loaded, spp=4))[..., 0] > 0


def exposure(image, mask):
    """So that the brightest twentieth of the materials is at the top."""
    return 0.9 / max(np.quantile(image[mask].mean(axis=-1), 0.95), 1e-9)


def tone_mapped(image, exposure):
    x = np.clip(image * exposure, 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def psnr(a, b):
    error = np.mean((a - b) ** 2)
    return math.inf if error == 0 else -10 * math.log10(error)


def write(path, image):
    mi.Bitmap((np.clip(image, 0, 1) * 255 + 0.5).astype(np.uint8)).write(str(path))


def compare(name, scene, files, tables, args):
    """Renders a scene with files and with tables; returns the PSNR."""
    start = time.perf_counter()
    mode = {"mode": args.mode} if args.mode else {}
    # The same directions are sampled for both.
    coded = [{"type": "csbrdf", "filename": f, "sampling": t, **mode} for f, t in zip(files, tables)]
    plain = [{"type": "csbrdf", "filename": t, "mode": "texture"} for t in tables]
    images = [picture(scene, coded, args), picture(scene, plain, args), picture(scene, plain, args, seed=1)]
    mask = shows_materials(scene, args)
    if not all(np.isfinite(image).all() for image in images):
        raise SystemExit(f"{name}: a picture has values that are not finite")
    shown = [tone_mapped(image, exposure(images[1], mask)) for image in images]
    for kind, image in zip(("csbrdf", "table"), shown):
        write(args.out / f"{name}-{kind}.png", image)
    write(args.out / f"{name}-difference.png", np.abs(shown[0] - shown[1]) * 50)
    found, noise = psnr(shown[0][mask], shown[1][mask]), psnr(shown[2][mask], shown[1][mask])
    print(f"{name}: PSNR {found:.1f} dB (noise alone {noise:.1f} dB), {time.perf_counter() - start:.1f} s")
    return found


def main(arguments=None):
    args = parse(arguments)
    mi.set_variant(args.variant)
    import csbrdf_mitsuba
    csbrdf_mitsuba.register()
    args.out.mkdir(parents=True, exist_ok=True)
    first = Path(args.file).stem
    with csbrdf_mitsuba.evaluated() if args.mode == "blocks" else contextlib.nullcontext():
        figures = [compare(f"{first}-sphere", sphere, [args.file], [args.table], args)]
        if args.second:
            name = f"{first}-{Path(args.second[0]).stem}-pair"
            files, tables = [args.file, args.second[0]], [args.table, args.second[1]]
            figures.append(compare(name, pair, files, tables, args))
    return args.at_least is None or min(figures) >= args.at_least


if __name__ == "__main__":
    sys.exit(0 if main() else 1)
