# SPDX-License-Identifier: Apache-2.0
"""Animation within objects: shapes, parts, visibility of groups."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from pxr import Usd, UsdGeom

import tiscene as ts
from tests.usd.helpers import STAGES, read, read_with_warning, write
from tiscene.scene.animation import between
from tiscene.usd.read.stage_reader import read_stage

RANGE = "startTimeCode = 0\n    endTimeCode = 10\n    timeCodesPerSecond = 10"
LABELS = ("instance", "depth", "position", "forward_flow", "backward_flow", "scene_flow")


def stream(path, **others):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        camera = ts.Camera(position=(0.0, 0.0, 10.0))
        options = {"width": 64, "height": 48, "fps": 10.0, "buffers": LABELS, "camera": camera} | others
        return ts.Stream(path, **options)


def placed(track, seconds):
    matrices, present = track.at(seconds)
    return matrices[..., 3].tolist(), present.tolist()


CLOTH = """
def Mesh "Cloth" {
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points.timeSamples = {
        0: [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)],
        10: [(-1, -1, 0), (3, -1, 0), (3, 1, 2), (-1, 1, 2)],
    }
    %s
}
"""


def test_mesh_points_are_interpolated_linearly_between_samples(tmp_path):
    (mesh,) = read(tmp_path, CLOTH % "", more=RANGE).meshes
    assert mesh.deformation.times.tolist() == [0.0, 1.0]
    assert mesh.positions[2].tolist() == [1, 1, 0]
    np.testing.assert_allclose(mesh.deformation.at(0.25)[0][2], (1.5, 1, 0.5))
    assert mesh.deformation.at(-1.0)[0].tolist() == mesh.positions.tolist()
    assert mesh.deformation.at(9.0)[0][2].tolist() == [3, 1, 2]
    assert mesh.deformation.at(0.5)[1] is None  # flat shading: no normals are authored


@pytest.mark.parametrize(
    "line",
    [
        "texCoord2f[] primvars:UVMap.timeSamples = { 0: [(0, 0), (1, 0)], 10: [(1, 1), (1, 0)] }",
        "texCoord2f[] primvars:UVMap = [(0, 0), (1, 0)]\n"
        "int[] primvars:UVMap:indices.timeSamples = { 0: [0, 1, 0, 1], 10: [1, 1, 0, 0] }",
    ],
)
def test_texture_coordinates_of_any_name_that_change_are_named(tmp_path, line):
    expected = "primvars:UVMap of a Mesh has time samples, and is drawn as it is at the time read: </Cloth>"
    read_with_warning(tmp_path, CLOTH % line, expected)


def test_reading_at_a_time_code_gives_a_static_mesh(tmp_path):
    (mesh,) = read_stage(write(tmp_path, CLOTH % "", more=RANGE), time_code=5.0).meshes
    assert mesh.deformation is None
    assert mesh.positions[2].tolist() == [2, 1, 1]


def test_depth_and_flow_of_a_deforming_mesh_match_its_surface(tmp_path):
    """Depth is that of the plane through the corners, flow that of the surface point."""
    frames = stream(write(tmp_path, CLOTH % "", more=RANGE), frames=12)
    for k in (0, 4, 9):
        frame, t = frames[k], k / 10.0
        hit = frame.instance == 1
        p = frame.position[hit]
        u, v = (p[:, 0] + 1.0) / (2.0 + 2.0 * t), (p[:, 1] + 1.0) / 2.0
        np.testing.assert_allclose(p[:, 2], 2.0 * t * v, atol=1e-5)
        then = min((k + 1) / 10.0, 1.0)
        moved = np.stack([(then - t) * 2.0 * u, np.zeros_like(u), (then - t) * 2.0 * v], axis=-1)
        np.testing.assert_allclose(frame.scene_flow[hit], moved, atol=1e-5)
        focal = frame.camera.K[0, 0]

        def pixel(q, focal=focal):
            return np.stack([q[:, 0], -q[:, 1]], axis=-1) * (focal / (10.0 - q[:, 2:]))

        np.testing.assert_allclose(frame.forward_flow[hit], pixel(p + moved) - pixel(p), atol=2e-4)
    np.testing.assert_array_equal(frames[3].depth, [frame.depth for frame in frames[:4]][3])
    box = frames[9].objects[0].world_bounds
    np.testing.assert_allclose(box, [[-1, -1, 0], [2.8, 1, 1.8]], atol=1e-5)
    assert frames[11].depth.tobytes() == frames[10].depth.tobytes()


def test_authored_normals_are_animated_with_the_points(tmp_path):
    normals = """normal3f[] normals (interpolation = "faceVarying")
    normal3f[] normals.timeSamples = {
        0: [(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)],
        10: [(0, -1, 1), (0, -1, 1), (0, -1, 1), (0, -1, 1)],
    }"""
    path = write(tmp_path, CLOTH % normals, more=RANGE)
    (mesh,) = read_stage(path).meshes
    root = np.sqrt(0.5)
    np.testing.assert_allclose(mesh.deformation.at(1.0)[1], [(0, -root, root)] * 4, atol=1e-6)
    frame = stream(path, buffers=("normal", "instance"))[10]
    np.testing.assert_allclose(
        frame.normal[frame.instance == 1], np.tile((0, -root, root), ((frame.instance == 1).sum(), 1)), atol=1e-6
    )


def test_subdivided_mesh_deforms_with_its_cage(tmp_path):
    """Subdivision is linear in the points: halfway between two cages is halfway between their surfaces."""
    body = """
def Mesh "Blob" {
    int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
    int[] faceVertexIndices = [0, 1, 3, 2, 2, 3, 5, 4, 4, 5, 7, 6, 6, 7, 1, 0, 1, 7, 5, 3, 6, 0, 2, 4]
    point3f[] points%s
}
"""
    cube = [(x, y, z) for z, y in ((1, -1), (1, 1), (-1, 1), (-1, -1)) for x in (-1, 1)]
    long = [(4 * x, y, z) for x, y, z in cube]
    moving = body % f".timeSamples = {{ 0: {cube}, 10: {long} }}"
    (mesh,) = read(tmp_path, moving, more=RANGE).meshes
    (half,) = read_stage(write(tmp_path, moving, more=RANGE), time_code=5.0).meshes
    positions, normals = mesh.deformation.at(0.5)
    low, high = positions.min(axis=0), positions.max(axis=0)
    np.testing.assert_allclose([low, high], [half.positions.min(axis=0), half.positions.max(axis=0)], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(mesh.deformation.normals, axis=-1), 1.0, atol=1e-6)
    np.testing.assert_allclose(positions[:, 0], mesh.positions[:, 0] * 2.5, atol=1e-6)
    assert (np.einsum("ij,ij->i", normals, positions) > 0.0).all()


@pytest.mark.parametrize(
    ("shape", "at_half"),
    [
        ('def Sphere "S"\n{\n double radius.timeSamples = { 0: 1, 10: 3 }\n}', 2.0),
        ('def Cube "C"\n{\n double size.timeSamples = { 0: 2, 10: 6 }\n}', 2.0),
        (
            'def Points "P"\n{\n point3f[] points = [(0, 0, 0)]\n float[] widths.timeSamples = { 0: [2], 10: [6] }\n}',
            2.0,
        ),
    ],
)
def test_animated_gprim_sizes_deform_their_meshes(tmp_path, shape, at_half):
    (mesh,) = read(tmp_path, shape, more=RANGE).meshes
    assert mesh.deformation.at(0.5)[0].max() == pytest.approx(at_half, rel=0.05)


MESH = 'uniform token subdivisionScheme = "none"\nint[] faceVertexCounts = [3]\nint[] faceVertexIndices = [0, 1, 2]'
CURVE = 'uniform token type = "linear"\nint[] curveVertexCounts = [3]\nfloat[] widths = [0.1]'


@pytest.mark.parametrize("acceleration", [False, True])
@pytest.mark.parametrize(
    ("kind", "shape"),
    [("Mesh", MESH), ("BasisCurves", CURVE), ("Points", "float[] widths = [1]")],
    ids=["Mesh", "BasisCurves", "Points"],
)
def test_velocities_carry_the_points_of_shapes_beyond_their_samples(tmp_path, kind, shape, acceleration):
    samples = ".timeSamples = { 2: [(0, 0, 0), (1, 0, 0), (1, 1, 0)] }"
    lines = f"point3f[] points{samples}\nvector3f[] velocities.timeSamples = {{ 2: {[(0, 10, 0)] * 3} }}\n"
    if acceleration:
        lines += f"vector3f[] accelerations.timeSamples = {{ 2: {[(0, 0, -20)] * 3} }}\n"
    path = write(tmp_path, f'def {kind} "Shape"\n{{\n{shape}\n{lines}}}\n', more=RANGE)
    stage = Usd.Stage.Open(str(path))
    based = UsdGeom.PointBased(stage.GetPrimAtPath("/Shape"))
    frames = stream(path, buffers=("instance",))
    for k in (0, 2, 3, 7, 10, 20):
        bounds = frames[k].objects[0].world_bounds
        points = np.array(based.ComputePointsAtTime(min(k, 10), min(k, 10)))
        expected = np.stack([points.min(axis=0), points.max(axis=0)])
        np.testing.assert_allclose(bounds.mean(axis=0), expected.mean(axis=0), atol=0.03)
    (mesh,) = read_stage(path, time_code=7.0).meshes
    height = 0.5 * (mesh.positions[:, 1].min() + mesh.positions[:, 1].max())
    assert height == pytest.approx(5.5, abs=0.03)


def test_constant_samples_are_not_animation(tmp_path):
    """Exporters write the topology, and many other attributes, at every frame."""
    body = (CLOTH % "").replace(
        "int[] faceVertexCounts = [4]", "int[] faceVertexCounts.timeSamples = { 0: [4], 10: [4] }"
    )
    assert read(tmp_path, body, more=RANGE).meshes[0].deformation is not None
    still = body.replace("(1, -1, 0), (1, 1, 0), (-1, 1, 0)", "(3, -1, 0), (3, 1, 2), (-1, 1, 2)")
    assert read(tmp_path, still, more=RANGE).meshes[0].deformation is None


def test_instances_share_a_deforming_mesh(tmp_path):
    body = (
        f'class "Proto"\n{{\n{CLOTH % ""}\n}}\n'
        + """
def "A" (
    instanceable = true
    inherits = </Proto>
) {}
def Xform "B" (
    instanceable = true
    inherits = </Proto>
) {
    double3 xformOp:translate = (0, 3, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
    )
    path = write(tmp_path, body, more=RANGE)
    description = read_stage(path)
    assert len(description.meshes) == 1
    frame = stream(path)[5]
    assert set(np.unique(frame.instance)) == {0, 1, 2}
    for number, up in ((1, 0.0), (2, 3.0)):
        p = frame.position[frame.instance == number]
        np.testing.assert_allclose(p[:, 2], (p[:, 1] - up + 1.0) / 2.0, atol=1e-4)


CAR = """
def Xform "Group" {
    %s
    def Xform "Car" (kind = "component") {
        %s
        def Cube "Body" {}
        def Cube "Wheel" {
            %s
        }
    }
}
"""
HIDDEN = 'token visibility.timeSamples = { 0: "inherited", 5: "invisible", 8: "inherited" }'
MOVED = """
            double3 xformOp:translate.timeSamples = { 0: (0, 3, 0), 10: (1, 3, 0) }
            uniform token[] xformOpOrder = ["xformOp:translate"]
"""
TURNED = """
            float xformOp:rotateZ.timeSamples = { 0: 0, 10: 360 }
            uniform token[] xformOpOrder = ["xformOp:rotateZ"]
"""


def test_parts_move_within_their_object(tmp_path):
    path = write(tmp_path, CAR % ("", "", MOVED), more=RANGE)
    (track,) = read_stage(path).tracks
    assert track.instances.tolist() == [1]
    assert placed(track, 0.25)[0] == [[0.25, 3, 0]]
    frame = stream(path)[5]
    assert frame.objects[0].position == (0.0, 0.0, 0.0)
    wheel = (frame.instance == 1) & (frame.position[..., 1] > 1.5)
    assert wheel.any()
    np.testing.assert_allclose(frame.scene_flow[wheel], np.tile((0.1, 0, 0), (wheel.sum(), 1)), atol=1e-6)
    assert not frame.scene_flow[(frame.instance == 1) & ~wheel].any()
    size = frame.objects[0].box_3d.size
    np.testing.assert_allclose(size, (3, 5, 2), atol=1e-5)  # of all that it ever takes up


def test_part_rotates_within_a_moving_object(tmp_path):
    """The wheel of a moving car: both motions combine, and are exact between samples of angles."""
    path = write(tmp_path, CAR % (MOVED, "", TURNED), more=RANGE)
    frames = stream(path)
    frame = frames[5]
    (row,) = frame.objects
    np.testing.assert_allclose(row.position, (0.5, 3.0, 0.0))
    placement = frames.world.state(5).placement
    assert placement.present.all()
    # Half a turn, then 36 degrees more.
    np.testing.assert_allclose(placement.world_from_object[1, 1, :, :3], np.diag([-1, -1, 1]), atol=1e-7)
    cosine = placement.world_from_object[2, 1, 0, 0]
    assert cosine == pytest.approx(np.cos(np.radians(216)), abs=1e-7)
    np.testing.assert_allclose(
        placement.world_from_object[1, 0], [[1, 0, 0, 0.5], [0, 1, 0, 3], [0, 0, 1, 0]], atol=1e-12
    )


@pytest.mark.parametrize(("group", "wheel", "gone"), [(HIDDEN, "", {1}), ("", HIDDEN, set())])
def test_animated_visibility_of_groups_and_parts(tmp_path, group, wheel, gone):
    path = write(tmp_path, CAR % (group, "", wheel), more=RANGE)
    frames = stream(path, buffers=("instance",))
    for k in (0, 4, 5, 7, 8, 20):
        there = not 5 <= k < 8
        assert frames.world.state(k).placement.present[1].tolist() == [there or not gone, there]
        assert {row.id for row in frames[k].objects} == ({1} if there else {1} - gone)
        assert frames[k].instance.any() == (there or not gone)


def test_moving_object_in_a_group_with_animated_visibility(tmp_path):
    path = write(tmp_path, CAR % (HIDDEN, MOVED, ""), more=RANGE)
    frames = stream(path, buffers=("instance",))
    assert [bool(frames[k].instance.any()) for k in (0, 4, 5, 7, 8)] == [True, True, False, False, True]


def test_skinned_mesh_is_posed_at_each_frame():
    """The upper joint rotates by nine degrees a frame, and a point a meter above it with it."""
    description = read_stage(STAGES / "skinned.usda")
    (mesh,), (instance,) = description.meshes, description.instances
    rate = len(mesh.deformation.times) - 1
    assert rate == 10
    last = mesh.deformation.times[-1]
    for k in range(11):
        positions, _ = mesh.deformation.at(last * k / 10.0)
        world = positions @ instance.world_from_object[:3, :3].T + instance.world_from_object[:3, 3]
        angle = np.radians(9.0 * k)
        at_top = np.array([-np.sin(angle), 1.0 + np.cos(angle), 0.0])
        assert np.abs(world - at_top).max(axis=1).min() < 1e-5


def test_between_returns_sample_index_and_fraction():
    times = np.array([0.0, 1.0, 3.0])
    assert between(times, -1.0) == (0, 0.0)
    assert between(times, 0.5) == (0, 0.5)
    assert between(times, 1.0) == (1, 0.0)
    assert between(times, 2.0) == (1, 0.5)
    assert between(times, 3.0 - 1e-12) == (2, 0.0)
    assert between(times, 9.0) == (2, 0.0)
