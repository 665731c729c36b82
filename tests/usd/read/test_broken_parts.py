# SPDX-License-Identifier: Apache-2.0
"""A broken part of a stage is named and left out; the rest is drawn, unless nothing is left or the caller is strict."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import tiscene as ts
from tests.usd.damage import crate_bytes
from tests.usd.helpers import QUAD, read, read_with_warning, write
from tiscene.errors import StageError, StageWarning
from tiscene.usd.read.stage_reader import read_stage
from tiscene.usd.read.template import read_template

CUBE = 'def Cube "Good" {}\n'
TRIANGLE = "int[] faceVertexIndices = [0, 1, 2]\npoint3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]\n"
INSTANCER = """def PointInstancer "P" {
    rel prototypes = </P/A>
    int[] protoIndices = [0, 0, 0]
    point3f[] positions = [(0, 0, 0), (1, 0, 0)]
    def Cube "A" {}
}
"""
BROKEN = {
    "reference": ('def "A" (references = @./missing.usda@) {}\n', "</A> composition: .*missing.usda"),
    "payload": ('def "A" (payload = @./missing.usda@) {}\n', "</A> composition: .*missing.usda"),
    "clips": (
        'def Cube "Clips" (clips = {\ndictionary default = {\nasset[] assetPaths = [@missing.usda@]\n'
        'string primPath = "/A"\ndouble2[] active = [(0, 0)]\n}\n}) {\ndouble size = -1\n}\n',
        "</Clips> composition: .*missing.usda@ for the value clips default",
    ),
    "cycle": (
        'def "A" (references = </B>) {}\ndef "B" (references = </A>) {}\n',
        "</A> composition: .*[cC]ycle",
    ),
    "internal": ('def "A" (references = </Nowhere>) {}\n', "</A> composition: .*Nowhere"),
    "inherits": ('def "A" (inherits = </A/B>) {\n    def "B" {}\n}\n', "</A> composition: .*A/B"),
    "mesh": (f'def Mesh "M"\n{{\nint[] faceVertexCounts = [4]\n{TRIANGLE}}}\n', "</M> mesh: .*add up to 4"),
    "type": (
        'def Mesh "M"\n{\nint[] faceVertexCounts = [3]\nint[] faceVertexIndices = [0, 1, 2]\n'
        'string[] points = ["a", "b", "c"]\n}\n',
        r"</M> cannot be read: points is string\[\], expected point3f\[\]",
    ),
    "width": (
        'def Points "M"\n{\nfloat2[] points = [(0, 0), (1, 0)]\nfloat[] widths = [1]\n}\n',
        r"</M> cannot be read: points is float2\[\], expected point3f\[\]",
    ),
    "instancer": (INSTANCER, "</P> instancer: 2 positions, but 3 protoIndices"),
    "points": (
        'def Points "M"\n{\npoint3f[] points = [(0, 0, 0), (1, 0, 0)]\nfloat[] widths = [1, 2, 3]\n}\n',
        "</M> points: 3 widths, but 2 points",
    ),
    "light": ('def SphereLight "L"\n{\nfloat inputs:intensity = nan\n}\n', "</L> light: intensity nan"),
    "multiplier": ('def SphereLight "L"\n{\nfloat inputs:diffuse = -1\n}\n', "</L> light: diffuse -1"),
    "camera": ('def Camera "C"\n{\nfloat focalLength = 0\n}\n', "</C> camera: .*focalLength 0"),
    "far": ('def Sphere "S"\n{\ndouble radius = 1e29\n}\n', "</S> geometry: its points reach farther"),
}


@pytest.mark.parametrize(("body", "text"), BROKEN.values(), ids=BROKEN)
def test_broken_part_is_named_and_the_rest_is_drawn(tmp_path, body, text):
    description = read_with_warning(tmp_path, CUBE + body, f"{text}.*; left out")
    assert [each.name for each in description.objects] == ["Good"]
    assert not description.lights
    assert not description.cameras
    with pytest.raises(StageError, match=text):
        read_stage(write(tmp_path, CUBE + body), strict=True)


@pytest.mark.parametrize("kind", [each for each in BROKEN if each not in ("camera", "light", "multiplier")])
def test_stage_of_which_nothing_is_left_is_refused(tmp_path, kind):
    body, text = BROKEN[kind]
    with pytest.raises(StageError, match=text):
        read(tmp_path, body)


def test_missing_sublayer_is_named_and_the_rest_is_drawn(tmp_path):
    missing = {"more": "subLayers = [@./missing.usda@]"}
    with pytest.warns(StageWarning, match=r"</> composition: .*missing\.usda.*; left out"):
        assert len(read(tmp_path, CUBE, **missing).instances) == 1
    with pytest.raises(StageError, match=r"missing\.usda"):
        read(tmp_path, "", **missing)


@pytest.mark.parametrize("shape", ["Cylinder", "Cone", "Capsule"])
def test_round_shape_of_zero_height_is_drawn_flat(tmp_path, shape):
    body = CUBE + f'def {shape} "Flat"\n{{\ndouble height = 0\n}}\n'
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        description = read(tmp_path, body)
    flat = description.meshes[description.instances[1].mesh]
    assert np.isfinite(flat.positions).all()
    assert flat.normals is None or np.allclose(np.linalg.norm(flat.normals, axis=1), 1.0, atol=1e-5)
    assert np.ptp(flat.positions[:, 2]) == (1.0 if shape == "Capsule" else 0.0)


def test_mesh_with_contradictory_creases_is_drawn_without_them(tmp_path):
    smooth = QUAD.replace('"none"', '"catmullClark"')
    plain = read(tmp_path, f'def Mesh "M"\n{{\n{smooth}\n}}')
    lines = "int[] creaseIndices = [0, 1, 2]\nint[] creaseLengths = [2]\nfloat[] creaseSharpnesses = [5]"
    odd = read_with_warning(tmp_path, f'def Mesh "M"\n{{\n{smooth}\n{lines}\n}}', "</M> creases: creaseLengths must")
    np.testing.assert_array_equal(odd.meshes[0].positions, plain.meshes[0].positions)


def test_unit_stored_as_float_is_read(tmp_path):
    """Blender 2.8 wrote metersPerUnit as a float; USD's own function raises an error for such a file."""
    data = crate_bytes(f"#usda 1.0\n(\n    metersPerUnit = 1\n)\n{CUBE}", tmp_path)
    double, single = b"\x80?\x00\x00\x09@", b"\x80?\x00\x00\x08@"  # inlined value 1, its type
    assert data.count(double) == 1
    path = tmp_path / "float.usdc"
    path.write_bytes(data.replace(double, single))
    assert read_stage(path).bounds()[1].tolist() == [1.0, 1.0, 1.0]


def test_crate_of_an_old_format_says_how_to_convert_it(tmp_path):
    data = bytearray(crate_bytes(f"#usda 1.0\n{CUBE}", tmp_path))
    data[8:11] = (0, 0, 1)
    old = tmp_path / "old.usdc"
    old.write_bytes(data)
    advice = r"old\.usdc is of version 0\.0\.1 .* reads 0\.4\.0 and later: convert it once with an older library"
    with pytest.raises(StageError, match=advice):
        read_stage(old)
    read_with_warning(tmp_path, CUBE + 'def "A" (references = @./old.usdc@</Good>) {}', f"</A> composition: .*{advice}")


MOVING = """def Xform "Empty" (kind = "component") {
    double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 10: (1, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Mesh "Bad" {
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points = [(0, 0, 0)]
    }
}
def Xform "Wild" (kind = "component") {
    double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 10: (nan, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Cube "C" {}
}
"""


def test_broken_moving_objects_do_not_lose_the_stream(tmp_path):
    path = write(tmp_path, CUBE + MOVING, more="startTimeCode = 0\nendTimeCode = 10")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        stream = ts.Stream(path, width=8, height=6, buffers=("instance",))
    text = "\n".join(str(each.message) for each in caught)
    assert "</Empty/Bad> mesh: 1 face refers to point 1" in text
    assert "</Wild" in text
    with stream:
        assert "Good" in [row.name for row in stream[1].objects]
        assert stream.scenario.objects == ()


def test_template_with_a_broken_part_keeps_the_rest(tmp_path):
    body = f'def Xform "Root"\n{{\n{CUBE}{BROKEN["mesh"][0]}}}\n'
    path = write(tmp_path, body, more='defaultPrim = "Root"')
    with pytest.warns(StageWarning, match="</Root/M> mesh: .*; left out"):
        assert len(read_template(path).description.instances) == 1


def test_refusal_says_what_is_left_and_how_to_go_on(tmp_path):
    missing = 'def "R" (references = @gone.usd@) {}\ndef NurbsPatch "N" {}\n'
    with pytest.raises(StageError) as caught:
        read_stage(write(tmp_path, missing))
    assert caught.value.advice == str(caught.value).split("\n")[-1]
    for text in ("nothing is left to draw", "prims of type NurbsPatch are not drawn", "Put the missing files where"):
        assert text in caught.value.advice
    assert "Mend the prims" not in caught.value.advice
    with pytest.raises(StageError, match=r"nothing is left to draw\. Mend the prims named above") as caught:
        read_stage(write(tmp_path, BROKEN["mesh"][0]), limits=ts.Limits())
    assert "missing files" not in caught.value.advice
    with pytest.raises(StageError, match="without it, the other parts are rendered"):
        read_stage(write(tmp_path, CUBE + BROKEN["mesh"][0]), strict=True)


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("empty.usda", b"", "It is empty: copy or export it again"),
        ("picture.usd", b"\x89PNG\r\n\x1a\n" + 99 * b"0", r"It has 107 bytes and begins with b'\\x89PNG"),
        ("archive.usdz", b"PK\x05\x06" + bytes(18), r"It has 22 bytes and begins with b'PK"),
    ],
)
def test_files_of_other_formats_say_how_they_begin(tmp_path, name, content, text):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(StageError, match=text):
        read_stage(tmp_path / name)


def test_messages_hold_no_addresses(tmp_path):
    text = 'def "A" (references = @stage.usda@</A>) {}\n' + CUBE
    read_with_warning(tmp_path, text, r"Cycle detected: @[^@]*stage\.usda@</A> references")


def test_transform_with_the_faces_of_a_mesh_is_reported(tmp_path):
    body = f'def Cube "Cube" {{}}\ndef Xform "Merged" {{{QUAD}}}'
    read_with_warning(tmp_path, body, r"of type Xform with the faces of a mesh.* are not drawn: </Merged>")
