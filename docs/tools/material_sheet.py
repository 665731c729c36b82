# SPDX-License-Identifier: Apache-2.0
"""Render the picture of MaterialX lobes in docs/usd.md: `python docs/tools/material_sheet.py [STAGE.usda]`.

STAGE.usda: keep the stage of the picture in this file.
"""

import argparse
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import tiscene as ts
from tiscene.cli.terminal import progress
from tiscene.export.png import write_png

IMAGE = Path(__file__).resolve().parents[1] / "images" / "materials.png"
WIDTH, HEIGHT, SPP = 960, 540, 64
_STANDARD, _OPEN = "ND_standard_surface_surfaceshader", "ND_open_pbr_surface_surfaceshader"
# Shader and inputs of each ball, from the left, back row first.
BALLS = {
    "Absorption": (
        _STANDARD,
        {"transmission": 1.0, "transmission_color": (0.9, 0.45, 0.1), "transmission_depth": 0.5,
         "specular_roughness": 0.0},
    ),
    "TintedGlass": (
        _STANDARD,
        {"transmission": 1.0, "transmission_color": (0.35, 0.75, 0.8), "specular_roughness": 0.0},
    ),
    "ThinWalled": (
        _STANDARD,
        {"transmission": 1.0, "thin_walled": True, "specular_roughness": 0.0, "transmission_color": (0.95, 0.97, 1.0)},
    ),
    "FrostedSheet": (_OPEN, {"transmission_weight": 1.0, "geometry_thin_walled": True, "specular_roughness": 0.5}),
    "Velvet": (
        _STANDARD,
        {"base_color": (0.12, 0.01, 0.03), "specular": 0.2, "specular_roughness": 0.9, "sheen": 1.0,
         "sheen_color": (0.9, 0.25, 0.35), "sheen_roughness": 0.35},
    ),
    "BrushedMetal": (
        _STANDARD,
        {"base": 1.0, "base_color": (0.75, 0.72, 0.68), "metalness": 1.0, "specular_roughness": 0.28,
         "specular_anisotropy": 0.8},
    ),
    "CandyPaint": (
        _STANDARD,
        {"base": 1.0, "base_color": (0.8, 0.8, 0.8), "metalness": 1.0, "specular_roughness": 0.45, "coat": 1.0,
         "coat_color": (0.1, 0.25, 0.7), "coat_roughness": 0.02},
    ),
    "PaperLantern": (
        _OPEN,
        {"geometry_thin_walled": True, "subsurface_weight": 1.0, "subsurface_color": (0.95, 0.8, 0.55),
         "specular_roughness": 0.8},
    ),
}  # fmt: skip
_TYPES = {"float": "float", "bool": "bool", "tuple": "color3f"}


def write_stage(path: Path) -> None:
    """Write the balls on a table, between two soft boxes."""
    prims = []
    for number, (name, (shader, inputs)) in enumerate(BALLS.items()):
        place = ((number % 4 - 1.5) * 1.25, 0.5, -1.2 + 1.6 * (number // 4))
        prims += [_material(name, shader, inputs), _ball(name, place)]
    for number, gray in enumerate((0.32, 0.5)):
        prims.append(_material(f"Gray{number}", _STANDARD, {"base_color": (gray,) * 3, "specular_roughness": 0.6}))
        fields = [(x, z) for x in range(-14, 14) for z in range(-6, 8) if (x + z) % 2 == number]
        corners = [(x + a, 0, z + b) for x, z in fields for a, b in ((0, 1), (1, 1), (1, 0), (0, 0))]
        prims.append(_faces(f"Table{number}", 0.5 * np.array(corners), f"Gray{number}"))
    prims.append(_faces("Wall", np.array([(-7, 0, -3), (7, 0, -3), (7, 6, -3), (-7, 6, -3)]), "Gray0"))
    prims += [
        _placed("SphereLight", "Bulb", (1.875, 0.5, 0.4), (0, 0, 0), radius=0.08, intensity=14),
        _placed("RectLight", "Key", (-3.0, 3.6, 2.2), (-48, -48, 0), width=2.2, height=1.4, intensity=9),
        _placed("RectLight", "Rim", (2.6, 2.6, -3.0), (-35, 142, 0), width=3.0, height=0.8, intensity=7),
        _placed("DomeLight", "Sky", (0, 0, 0), (0, 0, 0), intensity=0.35),
        _camera(),
    ]
    header = '#usda 1.0\n(\n    defaultPrim = "Sheet"\n    metersPerUnit = 1\n    upAxis = "Y"\n)\n'
    path.write_text(f'{header}def Xform "Sheet"\n{{\n{"".join(prims)}}}\n', encoding="utf-8")


def _material(name: str, shader: str, inputs: dict[str, Any]) -> str:
    lines = [f"{_TYPES[type(value).__name__]} inputs:{key} = {str(value).lower()}" for key, value in inputs.items()]
    surface = (
        f'def Shader "Surface" {{\nuniform token info:id = "{shader}"\ntoken outputs:out\n{chr(10).join(lines)}\n}}'
    )
    output = f"token outputs:mtlx:surface.connect = </Sheet/{name}Look/Surface.outputs:out>"
    return f'def Material "{name}Look" {{\n{output}\n{surface}\n}}\n'


def _ball(name: str, place: tuple[float, float, float]) -> str:
    """Return a sphere of radius 0.5 with texture coordinates: u around the vertical axis, v upwards."""
    rows, columns = 96, 192
    v, u = np.meshgrid(np.linspace(0.0, 1.0, rows + 1), np.linspace(0.0, 1.0, columns + 1), indexing="ij")
    polar, turn = np.pi * (1.0 - v), 2.0 * np.pi * u
    unit = np.stack([np.sin(polar) * np.sin(turn), np.cos(polar), np.sin(polar) * np.cos(turn)], axis=-1).reshape(-1, 3)
    first = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    faces = np.stack([first, first + 1, first + columns + 2, first + columns + 1], axis=-1)
    extra = (
        f'normal3f[] normals = {_tuples(unit)} (interpolation = "vertex")\n'
        f'texCoord2f[] primvars:st = {_tuples(np.stack([u.ravel(), v.ravel()], axis=-1))} (interpolation = "vertex")\n'
        f"double3 xformOp:translate = {place}\n"
        'uniform token[] xformOpOrder = ["xformOp:translate"]\n'
    )
    return _mesh(name, 0.5 * unit, faces, f"{name}Look", extra)


def _faces(name: str, corners: np.ndarray, look: str) -> str:
    """Return a mesh of quadrilaterals, four corners each."""
    return _mesh(name, corners, np.arange(len(corners)).reshape(-1, 4), f"{look}Look")


def _mesh(name: str, points: np.ndarray, faces: np.ndarray, look: str, more: str = "") -> str:
    return (
        f'def Mesh "{name}" (prepend apiSchemas = ["MaterialBindingAPI"]) {{\n'
        f'rel material:binding = </Sheet/{look}>\nuniform token subdivisionScheme = "none"\n'
        f"point3f[] points = {_tuples(points)}\nint[] faceVertexCounts = {[4] * len(faces)}\n"
        f"int[] faceVertexIndices = {faces.ravel().tolist()}\n{more}}}\n"
    )


def _tuples(rows: np.ndarray) -> str:
    return str([tuple(row) for row in rows.round(6).tolist()])


def _placed(kind: str, name: str, place: tuple[float, ...], turn: tuple[float, ...], **inputs: float) -> str:
    lines = "".join(f"float inputs:{key} = {value}\n" for key, value in inputs.items())
    order = 'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]'
    where = f"double3 xformOp:translate = {place}\nfloat3 xformOp:rotateXYZ = {turn}\n{order}\n"
    return f'def {kind} "{name}" {{\n{lines}{where}}}\n'


def _camera() -> str:
    lens = (
        f"float focalLength = 0.5\nfloat horizontalAperture = 0.36\nfloat verticalAperture = {0.36 * HEIGHT / WIDTH}\n"
    )
    return _placed("Camera", "Camera", (0.0, 4.4, 6.6), (-31.5, 0, 0)).replace("{\n", "{\n" + lens, 1)


def main() -> None:
    """Write the stage and its picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("stage", nargs="?", type=Path, metavar="STAGE.usda")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = arguments.stage or Path(folder) / "materials.usda"
        write_stage(path)
        stream = ts.Stream(
            str(path), width=WIDTH, height=HEIGHT, quality="photo", spp=SPP, max_depth=16, buffers=("rgb",)
        )
        with stream, progress("materials.png", 1):
            write_png(IMAGE, stream[0].rgb)


if __name__ == "__main__":
    main()
