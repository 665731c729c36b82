# SPDX-License-Identifier: Apache-2.0
"""Row "big": many objects, lights and triangles, large images, far and tiny worlds, and attributes without meaning.

Every scene is rendered in a process of its own, and compared with what is known about it.
"""

from __future__ import annotations

import math
import re
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tests.stress.child_process import ChildFailed, call
from tests.stress.outcomes import Outcome, count

SELF = "tests.stress.extreme_scenes"
SIZE = {"width": 96, "height": 72}
HEADER = '#usda 1.0\n(\n    defaultPrim = "World"\n    metersPerUnit = 1\n    upAxis = "Y"\n)\ndef Xform "World"\n{\n'
SKY = 'def DomeLight "Sky" {\nfloat inputs:intensity = 1\n}\n'
SPECIAL = ("nan", "inf", "-inf", "1e38", "0")
# Prims whose attributes get values without meaning, one at a time. "@" marks a value.
ATTRIBUTES = """
def Camera "Eye" {
    float focalLength = @50@
    float horizontalAperture = @36@
    float verticalAperture = @27@
    float2 clippingRange = (@0.01@, @1000@)
    float fStop = @0@
    double3 xformOp:translate = (@0@, @0.5@, @5@)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Cube "Box" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    double size = @1@
    double3 xformOp:translate = (@0@, @0@, @0@)
    float3 xformOp:rotateXYZ = (@0@, @30@, @0@)
    float3 xformOp:scale = (@1@, @1@, @1@)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"]
    rel material:binding = </World/Paint>
}
def Sphere "Ball" {
    double radius = @0.5@
    color3f[] primvars:displayColor = [(@0.5@, @0.2@, @0.1@)]
    double3 xformOp:translate = (@1@, @0@, @0@)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Mesh "Sheet" {
    point3f[] points = [(@-2@, -0.6, -2), (2, @-0.6@, -2), (2, -0.6, @2@), (-2, -0.6, 2)]
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [3, 2, 1, 0]
    normal3f[] normals = [(@0@, @1@, 0), (0, 1, 0), (0, 1, 0), (0, 1, 0)]
    texCoord2f[] primvars:st = [(@0@, 0), (1, 0), (1, 1), (0, 1)] ( interpolation = "vertex" )
}
def Material "Paint" {
    token outputs:surface.connect = </World/Paint/Surface.outputs:surface>
    def Shader "Surface" {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor = (@0.5@, @0.5@, 0.5)
        color3f inputs:emissiveColor = (@0@, 0, 0)
        float inputs:roughness = @0.5@
        float inputs:metallic = @0@
        float inputs:ior = @1.5@
        float inputs:opacity = @1@
        float inputs:clearcoat = @0@
        token outputs:surface
    }
}
def SphereLight "Lamp" {
    float inputs:intensity = @5@
    float inputs:exposure = @0@
    color3f inputs:color = (@1@, @1@, 1)
    float inputs:radius = @0.2@
    double3 xformOp:translate = (@1@, @3@, @1@)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def DistantLight "Sun" {
    float inputs:intensity = @1@
    float inputs:angle = @0.5@
}
def DomeLight "Sky" {
    float inputs:intensity = @0.5@
}
"""


def camera(distance: float, height: float = 0.0, offset: float = 0.0) -> str:
    """Return a camera that looks along -z from (offset, height, distance)."""
    return (
        'def Camera "Eye" {\nfloat focalLength = 30\nfloat horizontalAperture = 36\nfloat verticalAperture = 27\n'
        f"float2 clippingRange = ({distance * 1e-4!r}, {distance * 1e4!r})\n"
        f"double3 xformOp:translate = ({offset!r}, {height!r}, {distance!r})\n"
        'uniform token[] xformOpOrder = ["xformOp:translate"]\n}\n'
    )


def prim(kind: str, name: str, place: tuple[float, float, float], attributes: str, scale: float = 1.0) -> str:
    """Return a placed prim."""
    x, y, z = map(float, place)
    return (
        f'def {kind} "{name}" {{\n{attributes}\ndouble3 xformOp:translate = ({x!r}, {y!r}, {z!r})\n'
        f"double3 xformOp:scale = ({scale!r}, {scale!r}, {scale!r})\n"
        'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]\n}\n'
    )


def grid_of(kind: str, number: int, attributes: str, depth: float = 0.0) -> tuple[str, int]:
    """Return prims in a square grid in the plane z = depth, one unit apart, and the grid's side."""
    side = math.ceil(math.sqrt(number))
    prims = [
        prim(kind, f"P{row}", (row % side - 0.5 * (side - 1), row // side - 0.5 * (side - 1), depth), attributes)
        for row in range(number)
    ]
    return "".join(prims), side


def write_stage(folder: Path, *prims: str) -> str:
    """Write a stage; return its path."""
    path = folder / "stage.usda"
    path.write_text(HEADER + "".join(prims) + "}\n", encoding="utf-8")
    return str(path)


def render(path: str, buffers: list[str], index: int = 0, **settings: Any) -> dict[str, Any]:
    """Return buffers of a frame, its seconds, and its StageWarnings."""
    import tiscene as ts
    from tiscene.errors import StageWarning

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", StageWarning)
        began = time.perf_counter()
        with ts.Stream(path, buffers=tuple(buffers), **{**SIZE, "spp": 1, **settings}) as stream:
            ready = time.perf_counter()
            frame = stream[index]
            seconds = time.perf_counter() - ready
        arrays = {name: frame[name] for name in buffers}
    return {**arrays, "reading": ready - began, "seconds": seconds, "warnings": [str(each.message) for each in caught]}


def many_objects(number: int, folder: str) -> list[Any]:
    """Run in a child process: every one of many objects in a grid is seen."""
    prims, side = grid_of("Cube", number, "double size = 0.8")
    found = render(write_stage(Path(folder), SKY, camera(1.1 * side), prims), ["instance"], width=640, height=480)
    seen = len(np.unique(found["instance"])) - 1
    return [
        f"{seen:,} of {number:,} seen; read in {found['reading']:.1f} s, rendered in {found['seconds']:.2f} s",
        seen == number,
    ]


def many_lights(number: int, folder: str) -> list[Any]:
    """Run in a child process: many lights together are as bright as one of the same power."""
    means = []
    wall = prim("Cube", "Wall", (0, 0, 0), "double size = 1", scale=2.0) + camera(4.0)
    for lights, radius in ((1, 0.4), (number, 0.4 / math.sqrt(number))):
        prims = "".join(
            prim("SphereLight", f"L{row}", (0, 0, 8), f"float inputs:radius = {radius!r}\nfloat inputs:intensity = 50")
            for row in range(lights)
        )
        found = render(write_stage(Path(folder), wall, prims), ["hdr"], quality="standard", spp=64, max_depth=2)
        means.append(float(found["hdr"].mean()))
    ratio = means[1] / means[0]
    return [f"{ratio:.3f} of the light of one light with their area; {found['seconds']:.1f} s", abs(ratio - 1.0) < 0.05]


def large_image(width: int, folder: str) -> list[Any]:
    """Run in a child process: a large image has the labels of a small one at the same places."""
    height = width * 3 // 4
    small = render("object_view", ["instance"], width=width // 9, height=height // 9)["instance"]
    found = render("object_view", ["rgb", "instance"], width=small.shape[1] * 9, height=small.shape[0] * 9)
    equal = float((found["instance"][4::9, 4::9] == small).mean())
    return [f"{equal:.2%} of common pixel centers equal; rendered in {found['seconds']:.1f} s", equal > 0.999]


def many_triangles(number: int, folder: str) -> list[Any]:
    """Run in a child process: a mesh of many triangles, a flat grid, has the depth of a plane."""
    from pxr import Sdf, Usd, UsdGeom, Vt

    side = math.ceil(math.sqrt(number / 2))
    u = np.linspace(-2.0, 2.0, side + 1, dtype=np.float32)
    points = np.stack([*np.meshgrid(u, u), np.zeros((side + 1, side + 1), np.float32)], -1).reshape(-1, 3)
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).reshape(-1, 1)
    faces = (corner + np.array([0, 1, side + 2, side + 1])).astype(np.int32)
    path = write_stage(Path(folder), SKY, camera(3.0))
    stage = Usd.Stage.CreateNew(str(Path(folder, "mesh.usdc")))
    mesh = UsdGeom.Mesh.Define(stage, Sdf.Path("/World/Sheet"))
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces.reshape(-1)))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray(len(faces), 4))
    mesh.CreateSubdivisionSchemeAttr("none")
    stage.GetRootLayer().subLayerPaths.append(path)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.Save()
    found = render(str(Path(folder, "mesh.usdc")), ["depth"])
    error = float(np.abs(found["depth"] - 3.0).max())
    times = f"read in {found['reading']:.1f} s, rendered in {found['seconds']:.2f} s"
    return [f"{2 * len(faces):,} triangles; depth wrong by at most {error:.1e} m; {times}", error < 1e-4]


def large_texture(size: int, folder: str) -> list[Any]:
    """Run in a child process: a sheet with a large texture has its mean color."""
    from PIL import Image

    pixels = np.random.default_rng(1).integers(0, 256, (size, size, 3), np.uint8)
    Image.fromarray(pixels).save(Path(folder, "noise.png"), compress_level=1)
    sheet = """def Mesh "Sheet" (prepend apiSchemas = ["MaterialBindingAPI"]) {
        point3f[] points = [(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)]
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] ( interpolation = "vertex" )
        rel material:binding = </World/Paint>
    }
    def Material "Paint" {
        token outputs:surface.connect = </World/Paint/Surface.outputs:surface>
        def Shader "Surface" {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor.connect = </World/Paint/Noise.outputs:rgb>
            token outputs:surface
        }
        def Shader "Noise" {
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @noise.png@
            token inputs:sourceColorSpace = "raw"
            float2 inputs:st.connect = </World/Paint/Reader.outputs:result>
            float3 outputs:rgb
        }
        def Shader "Reader" {
            uniform token info:id = "UsdPrimvarReader_float2"
            string inputs:varname = "st"
            float2 outputs:result
        }
    }
    """
    found = render(write_stage(Path(folder), SKY, camera(1.0), sheet), ["albedo"])
    mean = float(found["albedo"].mean())
    expected = float(pixels.mean() / 255.0)
    times = f"read in {found['reading']:.1f} s, rendered in {found['seconds']:.2f} s"
    return [f"mean albedo {mean:.3f}, expected {expected:.3f}; {times}", abs(mean - expected) < 0.02]


def transformed(offset: float, scale: float, folder: str) -> list[Any]:
    """Run in a child process: a scene that is moved and scaled with its camera has the same labels."""
    results = []
    for moved, size in ((0.0, 1.0), (offset, scale)):
        prims = (
            prim("Cube", "Box", (moved - 0.8 * size, 0.0, 0.0), "double size = 1", scale=size),
            prim("Sphere", "Ball", (moved + 0.8 * size, 0.2 * size, 0.0), "double radius = 0.5", scale=size),
            prim("Cube", "Floor", (moved, -1.0 * size, 0.0), "double size = 1", scale=3.0 * size),
        )
        stage = write_stage(Path(folder), SKY, camera(4.0 * size, 0.5 * size, moved), *prims)
        results.append(render(stage, ["instance", "depth", "hdr"], spp=16))
    near, far = results
    differ = float((near["instance"] != far["instance"]).mean())
    both = np.isfinite(near["depth"]) & np.isfinite(far["depth"]) & (near["instance"] == far["instance"])
    depth = float(np.abs(far["depth"][both] / scale / near["depth"][both] - 1.0).max()) if both.any() else math.inf
    light = float(far["hdr"].mean() / near["hdr"].mean())
    warned = any("origin" in each or "precision" in each for each in far["warnings"])
    figures = f"{differ:.2%} of labels differ, depth by {depth:.1e}, brightness {light:.3f} of the original's"
    return [figures + ("; warned" if warned else ""), (differ < 0.02 and abs(light - 1.0) < 0.05) or warned]


def special_values(limit: int, folder: str) -> list[Any]:
    """Run in a child process: attributes that are NaN, infinite, huge or zero, one at a time.

    Each is refused or reported with the path of a prim, or the frame has finite values only.
    """
    from tiscene.errors import TisceneError

    pieces = ATTRIBUTES.split("@")
    cases = [(place, value) for place in range(1, len(pieces), 2) for value in SPECIAL]
    chosen = [cases[round(k * (len(cases) - 1) / max(limit - 1, 1))] for k in range(min(limit, len(cases)))]
    outcomes, wrong = {"refused": 0, "reported": 0, "rendered": 0}, []
    assert not render(write_stage(Path(folder), "".join(pieces)), ["hdr"], width=24, height=18)["warnings"]
    for place, value in chosen:
        text = "".join(value if row == place else piece for row, piece in enumerate(pieces))
        owner = re.findall(r'def \w+ "(\w+)"|(\w+(?::\w+)*) =', "".join(pieces[:place]))
        name = f"{[a for a, _ in owner if a][-1]}.{[b for _, b in owner if b][-1]} = {value}"
        try:
            found = render(write_stage(Path(folder), text), ["hdr", "depth", "instance", "normal"], width=24, height=18)
        except TisceneError as error:
            outcomes["refused"] += 1
            if "</World/" not in str(error) or "cannot be read" in str(error):
                wrong.append(f"{name}: {error}")
            continue
        except Exception as error:
            wrong.append(f"{name}: {error!r}")
            continue
        bad = [each for each in ("hdr", "normal") if not np.isfinite(found[each]).all()]
        bad += ["depth"] * bool(np.isnan(found["depth"]).any())
        outcomes["reported" if found["warnings"] else "rendered"] += 1
        wrong += [f"{name}: {', '.join(bad)} not finite"] if bad else []
        wrong += [f"{name}: {each}" for each in found["warnings"] if "/World" not in each and "no light" not in each]
    counts = ", ".join(f"{number} {kind}" for kind, number in outcomes.items())
    return [f"{counts}; {len(wrong)} wrong{': ' if wrong else ''}{'; '.join(wrong[:6])}", not wrong]


def zero_scale(number: int, folder: str) -> list[Any]:
    """Run in a child process: objects of scale zero are left out or reported, and the others are right."""
    flat = prim("Cube", "Flat", (0, 0, 1), "double size = 1", scale=0.0)
    box = prim("Cube", "Box", (0, 0, 0), "double size = 1")
    found = render(write_stage(Path(folder), SKY, camera(4.0), flat, box), ["instance", "depth"])
    wanted = render(write_stage(Path(folder), SKY, camera(4.0), box), ["depth"])
    same = bool(np.array_equal(found["depth"], wanted["depth"]))
    reported = any("/World/Flat" in each for each in found["warnings"])
    return [f"the rest is rendered as without it: {same}; reported with its path: {reported}", same]


def rows(scale: float) -> Iterator[Outcome]:
    """Run the row; scale 1 is the full count."""
    uses: list[tuple[str, str, list[Any]]] = []
    for function, what, full, least in (
        ("many_objects", "objects", 2000, 50),
        ("many_lights", "lights", 1000, 10),
        ("many_triangles", "triangles", 10_000_000, 20_000),
    ):
        uses.append((f"{count(full, scale, least):,} {what}", function, [count(full, scale, least)]))
    width, texture = (count(full, math.sqrt(scale), 256) for full in (4096, 8192))
    uses += [
        (f"a frame of about {width}x{width * 3 // 4}", "large_image", [width]),
        (f"a texture of {texture}x{texture}", "large_texture", [texture]),
        ("1e4 m from the origin", "transformed", [1e4, 1.0]),
        ("1e6 m from the origin", "transformed", [1e6, 1.0]),
        ("all at a scale of 1e-4", "transformed", [0.0, 1e-4]),
        ("all at a scale of 1e4", "transformed", [0.0, 1e4]),
        ("an object of scale 0", "zero_scale", [1]),
    ]
    values = count(SPECIAL_CASES, min(1.0, 4.0 * scale), 12)
    uses.append((f"{values} attributes that are NaN, infinite, 1e38 or 0", "special_values", [values]))
    for use, function, arguments in uses:
        with tempfile.TemporaryDirectory(prefix="tiscene-stress-") as folder:
            try:
                figures, held = call(f"{SELF}:{function}", *arguments, folder, seconds=7200)
                yield Outcome(use, figures, held)
            except ChildFailed as error:
                yield Outcome(use, str(error), False)


SPECIAL_CASES = len(SPECIAL) * (ATTRIBUTES.count("@") // 2)
