# SPDX-License-Identifier: Apache-2.0
"""Shapes whose topology or number of points changes over time."""

from __future__ import annotations

import numpy as np
import pytest

import tiscene as ts
from tests.usd.helpers import preview_material, read, read_with_warning, write
from tests.usd.read.test_animation import RANGE
from tests.usd.read.test_animation import stream as plain_stream
from tiscene.errors import StageWarning
from tiscene.scene.placement import CURRENT
from tiscene.usd.read import mesh_table
from tiscene.usd.read.stage_reader import read_stage

OCCLUSION = ("forward_occlusion", "backward_occlusion")
LABELS = (*OCCLUSION, "instance", "semantic", "part", "depth", "normal", "forward_flow", "scene_flow")
PLAIN = 'uniform token subdivisionScheme = "none"'
TRIANGLE, SHORT = "[(-2, -2, 0), (2, -2, 0), (2, 2, 0)]", "[(-2, -2, 0), (2, -2, 0), (2, 1, 0)]"
QUAD, LEANING = "[(-2, -2, 0), (2, -2, 0), (2, 2, 1), (-2, 2, 1)]", "[(-2, -2, 0), (2, -2, 0), (2, 2, 2), (-2, 2, 2)]"
FLUID = f"""
def Mesh "Fluid" {{
    {PLAIN}
    int[] faceVertexCounts.timeSamples = {{ 0: [3], 5: [4] }}
    int[] faceVertexIndices.timeSamples = {{ 0: [0, 1, 2], 5: [0, 1, 2, 3] }}
    point3f[] points.timeSamples = {{ 0: {TRIANGLE}, 4: {SHORT}, 5: {QUAD}, 10: {LEANING} }}
    %s
}}
"""
FEWER = f"""
def Mesh "Fluid" {{
    {PLAIN}
    int[] faceVertexCounts.timeSamples = {{ 0: %s, 5: [3], 7: [3, 3] }}
    int[] faceVertexIndices.timeSamples = {{ 0: %s, 5: [0, 1, 2], 7: [0, 1, 2, 0, 2, 3] }}
    point3f[] points = [(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)]
    %s
}}
"""
LINE = 'uniform token type = "linear"\n    float[] widths = [0.3]'
CURVES = f"""
def BasisCurves "Hair" {{
    {LINE}
    int[] curveVertexCounts.timeSamples = {{ 0: [2], 5: [2, 3] }}
    point3f[] points.timeSamples = {{
        0: [(0, 0, 0), (2, 0, 0)], 5: [(0, 0, 0), (2, 1, 0), (0, 1, 0), (1, 1, 0), (1, 2, 0)]
    }}
}}
"""
POINTS = """
def Points "Spray" {
    float[] widths.timeSamples = { 0: [1], 3: [2], 5: [1, 2] }
    point3f[] points.timeSamples = { 0: [(0, 0, 0)], 3: [(1, 0, 0)], 5: [(-1, 0, 0), (1, 1, 0)] }
}
"""
TETS = """
def TetMesh "Jelly" {
    int4[] tetVertexIndices.timeSamples = { 0: [(0, 1, 2, 3)], 5: [(0, 1, 2, 3), (1, 2, 3, 4)] }
    point3f[] points = [(0, 0, 0), (2, 0, 0), (0, 2, 0), (0, 0, 1), (2, 2, 1)]
}
"""
MOVED = """
    double3 xformOp:translate.timeSamples = { 0: (-1, 0, 0), 10: (1, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
"""


def stream(path, **others):
    return plain_stream(path, **{"buffers": LABELS, **others})


def assert_shows_the_stage(path, frames, codes=range(11), per_code=1):
    """Compare labels with those of the stage as it is read at each time code."""
    for k in codes:
        frame, still = frames[int(k * per_code)], stream(path, time_code=float(k))[0]
        np.testing.assert_array_equal(frame.instance, still.instance)
        np.testing.assert_array_equal(frame.semantic, still.semantic)
        np.testing.assert_array_equal(frame.part, still.part)
        np.testing.assert_allclose(frame.depth, still.depth, rtol=1e-6)
        np.testing.assert_allclose(frame.normal, still.normal, atol=1e-5)


@pytest.mark.parametrize("body", [FLUID % "", FEWER % ("[4]", "[0, 1, 2, 3]", ""), CURVES, POINTS, TETS])
def test_a_shape_whose_topology_changes_is_shown_as_it_is_at_each_time(tmp_path, body):
    path = write(tmp_path, body, more=RANGE)
    assert_shows_the_stage(path, stream(path))
    assert [each.parts for each in read_stage(path).objects] == [()]


def test_points_are_interpolated_within_one_topology_and_held_where_their_number_changes(tmp_path):
    path = write(tmp_path, FLUID % "", more=RANGE)
    assert_shows_the_stage(path, stream(path, fps=40.0), (0.25, 2.5, 4.0, 4.75, 5.0, 7.5), per_code=4)


def test_points_of_one_number_are_interpolated_up_to_the_change_as_usd_does(tmp_path):
    body = FEWER.replace("points =", "points.timeSamples =").replace(
        "[(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)]", f"{{ 0: {QUAD}, 10: {LEANING} }}"
    )
    path = write(tmp_path, body % ("[4]", "[0, 1, 2, 3]", ""), more=RANGE)
    assert_shows_the_stage(path, stream(path, fps=40.0), (0, 2.5, 4.75, 5, 6.75, 7, 9.5, 10), per_code=4)


@pytest.mark.parametrize("body", [f'def Xform "Thing" (kind = "component")\n{{\n{MOVED}\n%s\n}}', "%s"])
def test_flow_at_a_change_is_that_of_the_object_and_the_surface_ends(tmp_path, body):
    path = write(tmp_path, body % (FLUID % (MOVED if body == "%s" else "")), more=RANGE)
    frames = stream(path)
    assert_shows_the_stage(path, frames, (3, 4, 5, 6))
    frame = frames[4]
    hit = frame.instance == 1
    np.testing.assert_allclose(frame.scene_flow[hit], np.tile((0.2, 0, 0), (hit.sum(), 1)), atol=1e-6)
    assert frame.forward_occlusion[hit].all()
    assert frames[5].backward_occlusion[frames[5].instance == 1].all()
    assert not frames[3].forward_occlusion[hit & (frames[3].instance == 1)].all()
    assert len(frames[4].objects) == len(frames[5].objects) == 1


def test_a_shape_that_starts_empty_appears_without_a_warning(tmp_path):
    path = write(tmp_path, FEWER % ("[]", "[]", ""), more=RANGE)
    frames = stream(path)
    assert not frames[4].instance.any()
    assert not frames[4].objects
    assert (frames[5].instance == 1).any()
    assert_shows_the_stage(path, frames, range(5, 11))


def test_colors_and_materials_of_faces_follow_the_topology(tmp_path):
    colors = """
    color3f[] primvars:displayColor (
        interpolation = "uniform"
    )
    color3f[] primvars:displayColor.timeSamples = { 0: [(1, 0, 0)], 7: [(1, 0, 0), (0, 1, 0)] }
    def GeomSubset "Upper" {
        uniform token elementType = "face"
        int[] indices.timeSamples = { 0: [], 7: [1] }
    }
"""
    path = write(tmp_path, FEWER % ("[3]", "[1, 2, 3]", colors), more=RANGE)
    description = read_stage(path)
    assert description.objects[0].parts == ("Fluid/Upper", "Fluid")
    last = description.meshes[description.instances[-1].mesh]
    assert last.parts.tolist() == [1, 0]
    base = [description.materials[row].diffuse_color for row in last.materials.tolist()]
    assert base == [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]
    assert {each.part for each in description.instances} == {0}


def test_one_topology_alone_collides_with_objects(tmp_path):
    description = read(tmp_path, FLUID % "", more=RANGE)
    assert [each.collides for each in description.instances] == [True, False]


def test_points_of_an_instancer_show_the_topology_of_their_prototype(tmp_path):
    body = f"""
def PointInstancer "Pools" {{
    rel prototypes = </Pools/Fluid>
    int[] protoIndices = [0, 0]
    point3f[] positions = [(-2, 0, 0), (2, 0, -3)]
    {FLUID % ""}
}}
"""
    path = write(tmp_path, body, more=RANGE)
    frames = stream(path)
    assert set(np.unique(frames[2].instance)) == {0, 1, 2}
    assert_shows_the_stage(path, frames)


def test_incremental_frames_of_a_moving_camera_show_the_topology(tmp_path):
    path = write(tmp_path, 'def DistantLight "Sun" {}\n' + FLUID % "", more=RANGE)
    camera = ts.Camera(position=(0.0, 0.0, 10.0))
    options = {"buffers": ("hdr", "instance"), "spp": 16, "denoise": False, "camera": camera}
    reused, whole = (stream(path, incremental=each, **options) for each in (True, False))
    for k in (0, 4, 5, 9):
        np.testing.assert_array_equal(reused[k].instance, whole[k].instance)
        np.testing.assert_allclose(reused[k].hdr.mean(), whole[k].hdr.mean(), rtol=0.05)


def test_a_mesh_light_keeps_its_power_when_its_topology_changes(tmp_path):
    light = "float inputs:intensity = 3\n    bool inputs:normalize = 1"
    body = (FEWER % ("[4]", "[0, 1, 2, 3]", light)).replace(
        'def Mesh "Fluid"', 'def Mesh "Fluid" (\n    prepend apiSchemas = ["MeshLightAPI"]\n)'
    )
    description = read(tmp_path, body, more=RANGE)
    (track,) = description.material_tracks
    material = description.materials[track.row]
    emitted = [track.applied(material, track.moment(each)).emissive_color[0] for each in (0.0, 0.49, 0.5, 0.69, 0.7)]
    np.testing.assert_allclose(np.array(emitted) / emitted[0], (1, 1, 2, 2, 1), rtol=1e-6)


def test_too_many_triangles_keep_the_last_topology_that_fits(tmp_path, monkeypatch):
    monkeypatch.setattr(mesh_table, "MAX_TRIANGLES", 0)
    description = read_with_warning(tmp_path, FLUID % "", "keeps the one that it has after 0 triangles")
    assert len(description.instances) == 1
    assert not description.tracks


def test_a_written_scenario_keeps_the_topology_of_each_time(tmp_path):
    body = f'def Xform "Thing" (kind = "component")\n{{\n{MOVED}\n{FLUID % ""}\n}}'
    source = stream(write(tmp_path, body, more=RANGE))
    source.to_usd(tmp_path / "motion.usda", frames=11)
    again = stream(tmp_path / "motion.usda")
    for k in range(11):
        np.testing.assert_array_equal(again[k].instance > 0, source[k].instance > 0)
        np.testing.assert_allclose(again[k].depth, source[k].depth, rtol=1e-6)


def test_points_that_a_face_lacks_at_one_time_are_reported(tmp_path):
    body = (FLUID % "").replace("5: [(-2, -2, 0), ", "5: [")
    description = read_with_warning(tmp_path, body, "Fluid> mesh: 1 face refers to point 3, but the mesh has 3 points")
    shown = [[bool(track.at(code / 24.0)[1].any()) for track in description.tracks] for code in (4, 7, 10)]
    assert [any(each) for each in shown] == [True, False, True]


def test_a_subset_of_faces_of_another_topology_is_reported_once_and_keeps_the_others(tmp_path):
    subset = 'def GeomSubset "Upper"\n{\n uniform token elementType = "face"\n int[] indices = [0, 1]\n}'
    description = read_with_warning(
        tmp_path, FEWER % ("[3]", "[1, 2, 3]", subset), r"only at other times.*: </Fluid/Upper>$"
    )
    parts = [description.meshes[each.mesh].parts.tolist() for each in description.instances]
    assert parts == [[0], [0], [0, 0]]
    assert description.objects[0].parts == ()


def test_a_fault_at_many_times_is_reported_once(tmp_path):
    normals = 'normal3f[] normals = [(0, 0, 1), (0, 0, 1)] (\n interpolation = "uniform"\n)'
    body = FEWER % ("[3, 3, 3]", "[0, 1, 2, 0, 1, 3, 1, 2, 3]", normals)
    path = write(tmp_path, body)
    with pytest.warns(StageWarning) as caught:
        read_stage(path)
    (line,) = str(caught[0].message).splitlines()[1:]
    assert line == "  normals: 2 values, but uniform interpolation needs 3, so that it is not used: </Fluid>"


def test_subsets_of_faces_with_time_samples_have_their_materials_at_each_time(tmp_path):
    subset = """
    def GeomSubset "Red" (prepend apiSchemas = ["MaterialBindingAPI"]) {
        uniform token elementType = "face"
        uniform token familyName = "materialBind"
        int[] indices.timeSamples = { 0: [0], 5: [1], 8: [] }
        rel material:binding = </Red>
    }"""
    mesh = f"""
def Mesh "Floor" {{
    {PLAIN}
    int[] faceVertexCounts = [3, 3]
    int[] faceVertexIndices = [0, 1, 2, 0, 2, 3]
    point3f[] points.timeSamples = {{ 0: {QUAD}, 10: {LEANING} }}
    {subset}
}}
"""
    red = preview_material("/Red", "color3f inputs:diffuseColor = (1, 0, 0)")
    path = write(tmp_path, red + mesh, more=RANGE)
    frames = stream(path, buffers=(*LABELS, "albedo"))
    assert_shows_the_stage(path, frames)
    for k in range(11):
        still = stream(path, buffers=("albedo",), time_code=float(k))[0]
        np.testing.assert_allclose(frames[k].albedo, still.albedo, atol=1e-6)
    shares = [(frames[k].albedo[..., 0] == 1.0).mean() for k in (0, 5, 8)]
    assert shares[0] > 0.02
    assert shares[1] > 0.02
    assert shares[2] == 0.0


def wave(frames):
    """Return a mesh whose number of faces differs at each time code, with as many as 2 times 18 triangles."""
    shapes = []
    for k in range(frames):
        columns = 2 + 7 * k % 17
        x = np.linspace(-2.0, 2.0, columns)
        lower, upper = (np.stack([x, 0 * x + y, np.sin(x + k)], axis=1) for y in (-1.5, 1.5))
        left = np.arange(columns - 1)
        faces = np.stack([left, left + 1, left + 1 + columns, left + columns], axis=1).ravel().tolist()
        points = [tuple(each) for each in np.concatenate([lower, upper]).round(3).tolist()]
        shapes.append((f"{k}: {[4] * (columns - 1)}", f"{k}: {faces}", f"{k}: {points}"))
    names = "int[] faceVertexCounts", "int[] faceVertexIndices", "point3f[] points"
    lines = (
        f"{name}.timeSamples = {{ {', '.join(each)} }}"
        for name, each in zip(names, zip(*shapes, strict=True), strict=True)
    )
    return f'def Mesh "Wave"\n{{\n    {PLAIN}\n' + "\n".join(lines) + "\n}\n"


def test_topologies_are_on_the_device_while_frames_need_them_with_the_same_bytes_in_any_order(tmp_path):
    path = write(tmp_path, wave(11), more=RANGE)
    frames = stream(path)
    forward = {k: frames[k] for k in range(11)}
    scene = frames._renderer._scene
    assert sum(len(mesh.triangles) for mesh in scene.meshes) > 150
    assert scene._arrays.triangle_vertices.array.shape[0] <= 2 * 1 + 3 * 2 * 17
    assert len(scene._transient.rooms) == 3
    for box, mesh in zip(scene.mesh_boxes[CURRENT], scene.meshes, strict=True):  # known before a frame needs them
        np.testing.assert_allclose(box, (mesh.positions.min(axis=0), mesh.positions.max(axis=0)), atol=1e-5)
    backward = stream(path)
    for k in (10, 3, 4, 0, 9, 5):
        for name in LABELS:
            np.testing.assert_array_equal(backward[k][name], forward[k][name], err_msg=f"{k}: {name}")
    assert_shows_the_stage(path, frames, (7, 2, 8))


def test_topologies_are_shown_after_a_restart_that_keeps_trees_and_arrays(tmp_path):
    path = write(tmp_path, wave(11), more=RANGE)
    frames = stream(path)
    before = {k: frames[k] for k in (2, 9)}
    frames.restart(ts.Scenario("solid_benchmark"))
    frames[0]
    frames.restart(ts.Scenario(str(path), camera=ts.Camera(position=(0.0, 0.0, 10.0))))
    for k in (9, 2):
        for name in LABELS:
            np.testing.assert_array_equal(frames[k][name], before[k][name])
