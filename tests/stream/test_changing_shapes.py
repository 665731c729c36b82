# SPDX-License-Identifier: Apache-2.0
"""Incremental rendering of stages whose shapes, materials and instances change by time samples."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tiscene as ts
from tests.usd.helpers import preview_material, write
from tests.usd.read.test_animation import RANGE
from tests.usd.read.test_changing_topology import PLAIN
from tiscene.render.integrators.incremental.mover_coverage import dilated

LABELS = ("instance", "part", "depth", "normal", "forward_flow", "forward_occlusion", "albedo")
HERE = (0.0, 1.0, 3.0)
FRAMES = (2, 4, 7)
BLOCK = 8  # px
FLOOR = "[(-3, 0, 3), (3, 0, 3), (3, 0, -2), (-3, 0, -2)]"
WALL = "[(-3, 0, -2), (3, 0, -2), (3, 3, -2), (-3, 3, -2)]"
QUAD = "[(-0.5, 0.5, 0), (0.5, 0.5, 0), (0.5, 1.5, 0), (-0.5, 1.5, 0)]"
AHEAD = "[(-0.5, 0.5, 1), (0.5, 0.5, 1), (0.5, 1.5, 1), (-0.5, 1.5, 1)]"


def quad(name: str, points: str, more: str = "", color: str = "(0.6, 0.6, 0.6)") -> str:
    """Return a mesh of one face as text."""
    return f"""def Mesh "{name}" {{
    {PLAIN}
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points{points}
    color3f[] primvars:displayColor = [{color}]
    {more}
}}
"""


ROOM = (
    quad("Floor", f" = {FLOOR}")
    + quad("Wall", f" = {WALL}")
    + """def RectLight "Lamp" {
    float inputs:width = 2
    float inputs:height = 2
    float inputs:intensity = 4
    double3 xformOp:translate = (0.5, 2.9, 0.6)
    float xformOp:rotateX = -90
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX"]
}
def DomeLight "Sky" {
    float inputs:intensity = 0.2
}
"""
)
FLUID = f"""def Mesh "Fluid" {{
    {PLAIN}
    int[] faceVertexCounts.timeSamples = {{ 0: [4], 3: [4, 4], 4: [3], 5: [4, 4], 6: [4], 8: [3] }}
    int[] faceVertexIndices.timeSamples = {{
        0: [0, 1, 2, 3], 3: [0, 1, 2, 3, 1, 4, 5, 2], 4: [0, 1, 2], 5: [0, 1, 2, 3, 1, 4, 5, 2],
        6: [0, 1, 2, 3], 8: [0, 1, 2]
    }}
    point3f[] points.timeSamples = {{
        0: [(-1, 0.6, 0.5), (0, 0.6, 0.5), (0, 0.6, -0.5), (-1, 0.6, -0.5)],
        3: [(-1, 0.5, 0.5), (0, 0.7, 0.5), (0, 0.6, -0.5), (-1, 0.6, -0.5), (0.8, 0.7, 0.5), (0.8, 0.5, -0.5)],
        4: [(-1, 1, 0.5), (0.8, 0.7, 0.5), (0, 1, -0.5)],
        5: [(-1, 0.9, 0.5), (0, 0.7, 0.5), (0, 1, -0.5), (-1, 0.6, -0.5), (0.9, 0.7, 0.5), (0.8, 1, -0.5)],
        6: [(-1, 1.2, 0.5), (0.5, 0.6, 0.5), (0, 0.6, -0.5), (-1, 1.2, -0.5)],
        8: [(-1, 1.2, 0.5), (0.5, 0.6, 0.5), (0, 0.9, -0.5)]
    }}
    color3f[] primvars:displayColor = [(0.1, 0.2, 0.7)]
}}
"""
CLOTH = quad("Cloth", f".timeSamples = {{ 0: {QUAD}, 10: {AHEAD} }}", color="(0.7, 0.2, 0.1)")
BENDING = """def SkelRoot "Arm" {
    double3 xformOp:translate = (1.2, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Skeleton "Skeleton" (prepend apiSchemas = ["SkelBindingAPI"]) {
        uniform token[] joints = ["a"]
        uniform matrix4d[] bindTransforms = [((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))]
        uniform matrix4d[] restTransforms = [((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))]
        rel skel:animationSource = </Arm/Skeleton/Bend>
        def SkelAnimation "Bend" {
            uniform token[] joints = ["a"]
            float3[] translations = [(0, 0, 0)]
            quatf[] rotations.timeSamples = { 0: [(1, 0, 0, 0)], 10: [(0.8, 0, 0, 0.6)] }
            half3[] scales = [(1, 1, 1)]
        }
    }
    def Mesh "Skin" (prepend apiSchemas = ["SkelBindingAPI"]) {
        rel skel:skeleton = </Arm/Skeleton>
        uniform token subdivisionScheme = "none"
        int[] faceVertexCounts = [4, 4]
        int[] faceVertexIndices = [0, 1, 2, 3, 3, 2, 4, 5]
        point3f[] points = [(-0.2, 0, 0), (0.2, 0, 0), (0.2, 0.6, 0), (-0.2, 0.6, 0), (0.2, 1.2, 0), (-0.2, 1.2, 0)]
        int[] primvars:skel:jointIndices = [0, 0, 0, 0, 0, 0] (
            elementSize = 1
            interpolation = "vertex"
        )
        float[] primvars:skel:jointWeights = [0, 0, 0.5, 0.5, 1, 1] (
            elementSize = 1
            interpolation = "vertex"
        )
    }
}
"""


def camera(kind: str) -> ts.Camera:
    """Return a camera that stands still, turns or walks for a second."""
    ends = {
        "still": None,
        "turns": [ts.Waypoint(HERE, (-8.0, yaw, 0.0)) for yaw in (-8, 8)],
        "walks": [ts.Waypoint((x, HERE[1], HERE[2]), (-8.0, 0.0, 0.0)) for x in (-0.2, 0.2)],
    }[kind]
    return ts.Camera(HERE, exposure=0.0, dynamic=None if ends is None else ts.Keyframes((0.0, 1.0), ends))


def stream(path: Path, kind: str, **others: Any) -> ts.Stream:
    options = {"width": 48, "height": 32, "fps": 10.0, "buffers": ("hdr", *LABELS), "camera": camera(kind)}
    return ts.Stream(path, **(options | others))


def means(image: np.ndarray) -> np.ndarray:
    """Return the means of blocks of pixels."""
    height, width, channels = image.shape
    return image.reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK, channels).mean(axis=(1, 3))


@pytest.mark.parametrize("kind", ["still", "turns", "walks"])
def test_shapes_that_change_have_labels_and_light_of_path_traced_frames_in_any_order(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path, ROOM + FLUID + CLOTH + BENDING, more=RANGE)
    with stream(path, kind, quality="fast") as forward, stream(path, kind, quality="fast") as backward:
        frames = {k: forward[k] for k in FRAMES}
        for k in reversed(FRAMES):
            frame = backward[k]
            for name in ("hdr", *LABELS):
                np.testing.assert_array_equal(frame[name], frames[k][name], err_msg=f"{k}: {name}")
    with stream(path, kind, incremental=False, quality="standard", spp=64, denoise=False) as traced:
        for k in FRAMES:
            truth = traced[k]
            for name in LABELS:
                np.testing.assert_array_equal(frames[k][name], truth[name], err_msg=f"{k}: {name}")
            assert frames[k].hdr.mean() == pytest.approx(truth.hdr.mean(), rel=0.03)
            error = np.abs(means(frames[k].hdr) - means(truth.hdr))
            assert error.mean() < 0.05 * truth.hdr.mean()


RED = "(0.8, 0.05, 0.05)"
VARYING = preview_material(
    "/Varying", "color3f inputs:diffuseColor.timeSamples = { 0: (0.7, 0.1, 0.1), 8: (0.1, 0.1, 0.7) }"
)
HIDDEN = 'token visibility.timeSamples = { 0: "inherited", 3: "invisible", 6: "inherited" }'
SHOWN = 'token visibility.timeSamples = { 0: "invisible", 3: "inherited" }'
CROWD = f"""def PointInstancer "Crowd" {{
    rel prototypes = </Crowd/Card>
    int[] protoIndices.timeSamples = {{ 0: [0], 3: [0, 0], 6: [0] }}
    int64[] ids.timeSamples = {{ 0: [1], 3: [1, 2], 6: [2] }}
    point3f[] positions.timeSamples = {{ 0: [(-0.8, 0, 0)], 3: [(-0.6, 0, 0), (0.8, 0, 0)], 6: [(0.4, 0, 0.2)] }}
    {quad("Card", f" = {QUAD}", color=RED)}
}}
"""


@pytest.mark.parametrize(
    "body",
    [
        quad("Card", f" = {QUAD}", HIDDEN, RED),
        quad("Card", f" = {QUAD}", SHOWN, RED),
        f'def Xform "All" (\n    kind = "component"\n)\n{{\n    {HIDDEN}\n{quad("Card", f" = {QUAD}", color=RED)}}}\n',
        CROWD,
        VARYING
        + quad("Card", f" = {QUAD}", "rel material:binding = </Varying>").replace(
            '"Card"', '"Card" (\n    prepend apiSchemas = ["MaterialBindingAPI"]\n)'
        ),
        quad("Card", f" = {QUAD}").replace(
            "Color = [(0.6, 0.6, 0.6)]", "Color.timeSamples = { 0: [(1, 0, 0)], 8: [(0, 0, 1)] }"
        ),
    ],
    ids=["vanishes", "appears", "group", "instancer", "material", "color"],
)
def test_what_appears_vanishes_and_changes_color_has_the_light_of_path_traced_frames(tmp_path: Path, body: str) -> None:
    path = write(tmp_path, ROOM + body, more=RANGE)
    reused = stream(path, "still", quality="standard", spp=8, incremental=True)
    traced = stream(path, "still", quality="standard", spp=64, incremental=False)
    shown = []
    for k in (1, 4, 8):
        frame, truth = reused[k], traced[k]
        for name in LABELS:
            np.testing.assert_array_equal(frame[name], truth[name], err_msg=f"{k}: {name}")
        np.testing.assert_allclose(means(frame.hdr), means(truth.hdr), rtol=0.06, atol=0.01)
        shown.append(truth.hdr)
    assert np.abs(means(shown[0]) / means(shown[1]) - 1.0).max() > 0.12  # what changes is seen


STAYS = quad("Still", f" = {QUAD}", color=RED)
RESTS = f".timeSamples = {{ 0: {QUAD}, 4: {QUAD}, 8: {AHEAD} }}"
MOVES, FOLLOWS = quad("Mover", RESTS, color="(0.05, 0.05, 0.8)"), quad("Other", RESTS, color="(0.05, 0.8, 0.05)")
CHANNELS = {"Still": 0, "Other": 1, "Mover": 2}


@pytest.mark.parametrize("kind", ["still", "turns"])
@pytest.mark.parametrize("names", [("Still", "Mover"), ("Mover", "Still"), ("Other", "Mover")])
def test_of_surfaces_at_one_place_light_and_labels_show_the_first(
    tmp_path: Path, kind: str, names: tuple[str, str]
) -> None:
    bodies = {"Still": STAYS, "Mover": MOVES, "Other": FOLLOWS}
    path = write(tmp_path, ROOM + "".join(bodies[name] for name in names), more=RANGE)
    incremental = {"quality": "standard", "spp": 8, "incremental": True} if kind == "still" else {"quality": "preview"}
    for options in (incremental, {"quality": "standard", "spp": 8, "incremental": False}):
        with stream(path, kind, **options) as frames:
            frame = frames[2]
        name = next(each.name for each in frame.objects if each.id == frame.instance[14, 24])
        color = frame.hdr[12:16, 22:26].mean(axis=(0, 1))
        assert name == names[0]
        assert int(color.argmax()) == CHANNELS[name]
        assert np.sort(color)[1] < 0.4 * color.max()


def test_shadows_beside_moving_objects_are_as_dark_as_path_traced(tmp_path: Path) -> None:
    """They are as wide as a pixel or two of the reduced size at which changes of light are found."""
    box = """def Cube "Box" {
    double size = 0.3
    double3 xformOp:translate.timeSamples = { 0: (-0.4, 0.15, 1.2), 10: (0.0, 0.15, 1.2) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
    options: dict[str, Any] = {"width": 72, "height": 48, "buffers": ("hdr", "denoised", "instance")}
    truth = {"quality": "standard", "incremental": False, "spp": 256, "denoise": False} | options
    with (
        stream(write(tmp_path, ROOM + box, more=RANGE), "turns", quality="fast", **options) as boxed,
        stream(tmp_path / "stage.usda", "turns", **truth) as traced,
        stream(write(tmp_path, ROOM, name="empty.usda", more=RANGE), "turns", **truth) as empty,
    ):
        frame, expected, before = boxed[4], traced[4].hdr.sum(axis=-1), empty[4].hdr.sum(axis=-1)
        own = frame.instance == next(each.id for each in frame.objects if each.name == "Box")
        near = dilated(dilated(dilated(dilated(own)))) & ~dilated(own)
        shadow = near & (expected < 0.9 * before)
        assert shadow.sum() > 20
        assert before[shadow].mean() > 1.2 * expected[shadow].mean()
        assert frame.denoised.sum(axis=-1)[shadow].mean() == pytest.approx(expected[shadow].mean(), rel=0.06)
