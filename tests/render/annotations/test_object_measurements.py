# SPDX-License-Identifier: Apache-2.0
"""Boxes and pixel counts against values computed by hand, for 200 x 200 px and a focal length of 200 px."""

import copy
import pickle
import threading
from dataclasses import dataclass, replace

import numpy as np
import pytest
import trimesh

from tests.render.label_scenes import (
    ALL_TIMES,
    PlacedMesh,
    Stage,
    crowd,
    mesh_of,
    placement_of,
    plate,
    pose,
    static_view,
)
from tiscene.device import runtime
from tiscene.errors import ObjectNotFound
from tiscene.frame.object_table import ObjectTable
from tiscene.render.annotations.amodal_masks import MAX_SAMPLES, PixelCounter
from tiscene.render.annotations.object_measurements import Measurer
from tiscene.render.view import View
from tiscene.scene.camera import Camera, Vector3
from tiscene.scene.description import Material, Texture, TextureLookup

SIZE = 200
VIEW = static_view(Camera(position=(0.0, 0.0, 0.0), vertical_fov=2 * np.arctan(0.5), near=0.1), SIZE, SIZE)


@dataclass(frozen=True)
class State:
    id: int
    name: str
    template: str = ""
    category: str = "thing"
    category_id: int = 1
    prim_path: str = ""
    position: tuple[float, float, float] = (1.0, 2.0, 3.0)
    rotation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    velocity: tuple[float, float, float] = (0.5, 0.0, 0.0)
    first_frame: int = 0
    last_frame: int | None = None
    blocked: bool = False
    parts: tuple[str, ...] = ()
    asset: str = ""
    room: str = ""
    box: tuple[Vector3, Vector3] = ((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))


def table(stage: Stage, view: View = VIEW) -> ObjectTable:
    ids = sorted(set(stage.placement.instance_id.tolist()))
    return Measurer(stage.scene).table(stage.placement, view, [State(id, f"thing {id}") for id in ids])


def test_plate_half_outside_the_image_and_half_occluded() -> None:
    # 2 m at 4 m: 100 px square, centered on the right edge. A nearer plate covers the upper half of the visible part.
    stage = Stage(
        [plate(2.0, 2.0), plate(4.0, 0.5)],
        [PlacedMesh(0, [pose((2, 0, -4))]), PlacedMesh(1, [pose((0, 0.25, -2))])],
    )
    seen = table(stage).by_id(1)
    assert seen.amodal_box == pytest.approx((150, 50, 250, 150))
    assert seen.visible_box == (150, 100, 200, 150)
    assert seen.amodal_pixels == 100 * 100
    assert seen.visible_pixels == 50 * 50
    assert seen.fraction_in_frame == 0.5
    assert seen.visibility_in_frame == 0.5
    assert seen.fraction_visible == 0.25
    image = stage.render(VIEW, "instance")["instance"]
    x0, y0, x1, y1 = map(int, seen.visible_box)
    assert (image[y0:y1, x0:x1] == 1).all()
    assert (image == 1).sum() == seen.visible_pixels


def test_fractions_of_some_rows_equal_those_of_all_and_measure_no_others(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(
        [plate(2.0, 2.0), plate(4.0, 0.5)],
        [PlacedMesh(0, [pose((2, 0, -4))]), PlacedMesh(1, [pose((0, 0.25, -2))]), PlacedMesh(0, [pose((0, 0, -9))])],
    )
    counted: list[int] = []
    count = PixelCounter.count
    monkeypatch.setattr(
        PixelCounter, "count", lambda self, view, parts: counted.append(len(parts)) or count(self, view, parts)
    )
    rows = table(stage)
    some = [rows[2], rows[0]]
    fractions = rows.fractions_visible(some)
    assert counted == [2]
    assert fractions == [row.fraction_visible for row in some]
    assert fractions[1] == 0.25
    assert sum(counted) == 3  # those that were measured are kept
    assert pickle.loads(pickle.dumps(rows)).fractions_visible(some) == fractions


def test_objects_out_of_view_have_no_boxes_or_pixels() -> None:
    stage = Stage(
        [plate(2.0, 2.0), plate(9.0, 9.0)],
        [
            PlacedMesh(0, [pose((0, 0, -4))]),
            PlacedMesh(0, [pose((0, 0, 4))]),
            PlacedMesh(0, [pose((5, 0, -4))]),
            PlacedMesh(1, [pose((0, 0, -2))]),
        ],
    )
    hidden, behind, aside, _ = table(stage)
    for row in (hidden, behind, aside):
        assert row.visible_box is None
        assert row.visible_pixels == 0
        assert row.fraction_visible == 0.0
    assert hidden.amodal_box == pytest.approx((50, 50, 150, 150))
    assert (hidden.fraction_in_frame, hidden.visibility_in_frame) == (1.0, 0.0)
    assert behind.amodal_box is None
    assert behind.amodal_pixels == 0
    assert aside.amodal_box == pytest.approx((300, 50, 400, 150))
    assert (aside.amodal_pixels, aside.fraction_in_frame) == (10000, 0.0)


def test_pixel_of_several_parts_counts_once() -> None:
    stage = Stage(
        [plate(2.0, 2.0)],
        [
            PlacedMesh(0, [pose((0, 0, -4))], id=7),
            PlacedMesh(0, [pose((0, 0, -4.001))], id=7),
            PlacedMesh(0, [pose((2, 0, -4))], id=7),
        ],
    )
    row = table(stage).by_id(7)
    assert row.amodal_box == pytest.approx((50, 50, 250, 150), abs=0.02)
    assert row.amodal_pixels == 200 * 100
    assert row.visible_pixels == 150 * 100
    assert row.fraction_in_frame == 0.75
    assert row.visibility_in_frame == 1.0
    np.testing.assert_allclose(row.world_bounds, [[-1, -1, -4.001], [3, 1, -4]])


def test_pixels_far_outside_the_image_are_subsampled() -> None:
    # 40 m at 4 m: 2000 px square, of which 200 px square are in the image.
    row = table(Stage([plate(40.0, 40.0)], [PlacedMesh(0, [pose((0, 0, -4))])]))[0]
    assert 10 * MAX_SAMPLES < 2000 * 2000
    assert row.amodal_pixels == pytest.approx(2000 * 2000, rel=0.01)
    assert row.fraction_in_frame == pytest.approx(0.01, rel=0.01)
    assert row.visibility_in_frame == 1.0


def test_floor_below_the_camera_is_clipped_at_the_near_plane() -> None:
    turn = (np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0)
    row = table(Stage([plate(4.0, 20.0)], [PlacedMesh(0, [pose((0, -1, 0), turn)])]))[0]
    # Nearest, at z = 0.1 m, 2 m right and 1 m down are 4000 and 2000 px; farthest, at z = 10 m, 1 m down is 20 px.
    assert row.amodal_box == pytest.approx((100 - 4000, 120, 100 + 4000, 2100), rel=1e-5)
    assert row.visible_box == (0, 120, 200, 200)
    assert 0.0 < row.fraction_in_frame < 0.1
    assert row.visibility_in_frame == 1.0


def test_objects_nearer_than_the_near_plane_are_measured_as_they_are_seen() -> None:
    # 4 cm at 8 cm: 100 px square. A rod from 5 to 25 mm in front of the camera is behind its clipping plane.
    rod = mesh_of(trimesh.creation.box((0.001, 0.001, 0.02)))
    stage = Stage(
        [plate(0.04, 0.04), rod], [PlacedMesh(0, [pose((0, 0, -0.08))]), PlacedMesh(1, [pose((0, 0, -0.015))])]
    )
    near, rod = table(stage)
    assert near.amodal_box == pytest.approx((50, 50, 150, 150))
    assert near.amodal_pixels == 100 * 100
    assert near.fraction_in_frame == 1.0
    assert rod.amodal_box == pytest.approx((80, 80, 120, 120))
    assert rod.visible_pixels == rod.amodal_pixels == 40 * 40


def test_holes_and_surfaces_that_the_camera_does_not_see_are_not_amodal_pixels() -> None:
    pixels = np.ones((1, 2, 4), np.float32)
    pixels[0, 1, 3] = 0.0
    materials = [
        Material("wall"),
        Material("lace", opacity=TextureLookup(0, channel="a"), opacity_threshold=0.5),
        Material("unseen", seen_by_camera=False),
    ]
    stage = Stage(
        [plate(2.0, 2.0, material=row) for row in range(3)],
        [
            PlacedMesh(0, [pose((0.5, 0, -3))]),
            PlacedMesh(1, [pose((2, 0, -4))], id=2),
            PlacedMesh(0, [pose((2.5, 0, -4.001))], id=2),
            PlacedMesh(1, [pose((0, 0, -2))], id=3),
            PlacedMesh(2, [pose((0, 0, -1))], id=4),
        ],
        materials,
        [Texture("hole", pixels, encoding="raw", wrap_s="clamp", wrap_t="clamp")],
    )
    rows = table(stage)
    lace = rows.by_id(3)
    assert (lace.amodal_pixels, lace.visible_pixels, lace.visibility_in_frame) == (100 * 200, 100 * 200, 1.0)
    assert lace.amodal_mask[:, :100].all()
    assert not lace.amodal_mask[:, 100:].any()
    assert rows.by_id(4).amodal_pixels == 0
    # From 1 to 2 m the left half of the lace, from 1.5 to 3.5 m the plate behind it.
    assert rows.by_id(2).amodal_pixels == pytest.approx(125 * 100, abs=2 * 100)


def test_oriented_boxes_in_world_space() -> None:
    turn = (np.cos(0.3), 0.0, np.sin(0.3), 0.0)
    box = mesh_of(trimesh.creation.box((2.0, 1.0, 0.5)))
    stage = Stage([box], [PlacedMesh(0, [pose((1, 2, -5), turn, scale=2.0)])])
    state = State(1, "thing", position=(1.0, 2.0, -5.0), rotation=turn, box=((-2.0, -1.0, -0.5), (2.0, 1.0, 0.5)))
    row = Measurer(stage.scene).table(stage.placement, VIEW, [state])[0]
    box = row.box_3d
    assert box.center == pytest.approx((1, 2, -5))
    assert box.size == pytest.approx((4, 2, 1))
    assert box.rotation == turn
    corners = box.corners()
    np.testing.assert_allclose(row.world_bounds, [corners.min(axis=0), corners.max(axis=0)], atol=1e-6)
    np.testing.assert_allclose(corners[1] - corners[0], [4 * np.cos(0.6), 0, -4 * np.sin(0.6)], atol=1e-6)


def test_rows_are_measurable_after_the_scene_was_placed_again() -> None:
    stage = crowd(30)
    view = static_view(Camera.look_at((1.0, 0.8, 7.5), (0.1, 0.0, -1.0)), 64, 48)
    at_once = table(stage, view).columns()
    late = table(stage, view)
    elsewhere = [PlacedMesh(instance.mesh, [pose((0, 0, -40))]) for instance in stage.instances[:5]]
    stage.scene.place(placement_of(elsewhere, stage.meshes), ALL_TIMES)
    columns = late.columns()
    for name, column in at_once.items():
        np.testing.assert_array_equal(columns[name], column, name)
    assert (columns["visible_pixels"] > 0).sum() > 20
    assert (columns["visible_pixels"] <= np.rint(columns["fraction_in_frame"] * columns["amodal_pixels"])).all()


def test_visible_pixels_sum_to_the_image() -> None:
    stage = crowd(30)
    view = static_view(Camera.look_at((1.0, 0.8, 7.5), (0.1, 0.0, -1.0)), 64, 48)
    image = stage.render(view, "instance")["instance"]
    rows = table(stage, view)
    assert sum(row.visible_pixels for row in rows) == np.count_nonzero(image)
    for row in rows:
        y, x = np.nonzero(image == row.id)
        expected = (x.min(), y.min(), x.max() + 1, y.max() + 1) if len(x) else None
        assert row.visible_box == expected


def test_table_access_by_row_name_and_column() -> None:
    stage = Stage([plate(1.0, 1.0)], [PlacedMesh(0, [pose((x, 0, -4))]) for x in (-1, 1)])
    rows = table(stage)
    assert len(rows) == 2
    assert [row.name for row in rows] == ["thing 1", "thing 2"]
    assert rows.by_name("thing 2") is rows[1] is rows[-1]
    assert rows[0:1] == (rows[0],)
    assert repr(rows) == "<2 objects: thing 1, thing 2>"
    np.testing.assert_array_equal(rows[0].world_from_object[:3, 3], (1, 2, 3))
    with pytest.raises(ObjectNotFound, match="Did you mean 'thing 1'"):
        rows.by_name("thing1")
    with pytest.raises(ObjectNotFound, match=r"no object 19 in.*thing 1 \(1\), thing 2 \(2\)\. Ids"):
        rows.by_id(np.int32(19))
    columns = rows.arrays()
    assert columns["id"].dtype == np.int32
    assert columns["visible_box"].shape == (2, 4)
    assert columns["last_frame"].tolist() == [-1, -1]


def test_static_objects_are_measured_once_with_same_result(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = crowd(12)
    view = static_view(Camera.look_at((1.0, 0.8, 7.5), (0.1, 0.0, -1.0)), 64, 48)
    measurer = Measurer(stage.scene)
    states = [State(id, f"thing {id}") for id in range(1, 14)]
    counted: list[int] = []
    count = PixelCounter.count
    monkeypatch.setattr(
        PixelCounter, "count", lambda self, view, parts: counted.append(len(parts)) or count(self, view, parts)
    )
    for frame in range(4):
        resting = [PlacedMesh(instance.mesh, [instance.poses[0]], id=instance.id) for instance in stage.instances]
        resting[3] = PlacedMesh(0, [pose((0.3 * frame, 0.0, 1.0))], (True, frame != 2, True))
        resting.append(PlacedMesh(1, [pose((0, 0, 2))]))
        placement = placement_of(resting[: 12 + (frame > 1)], stage.meshes)
        present = [state for state in states if state.id in placement.instance_id]
        kept, fresh = (each.table(placement, view, present) for each in (measurer, Measurer(stage.scene)))
        columns = kept.columns()
        for name, column in fresh.columns().items():
            np.testing.assert_array_equal(columns[name], column, name)
        for ours, theirs in zip(kept, fresh, strict=True):
            np.testing.assert_array_equal(ours.amodal_mask, theirs.amodal_mask)
    assert counted == [12, 12, 1, 12, 2, 13, 1, 13]


def test_amodal_mask_equals_rendering_of_object_alone() -> None:
    stage = crowd(12)
    view = static_view(Camera.look_at((1.0, 0.8, 7.5), (0.1, 0.0, -1.0)), 64, 48)
    rows = table(stage, view)
    image = stage.render(view, "instance")["instance"]
    for row in rows:
        stage.scene.place(
            replace(stage.placement, present=stage.placement.present & (stage.placement.instance_id == row.id))
        )
        alone = stage.render(view, "instance")["instance"] == row.id
        np.testing.assert_array_equal(row.amodal_mask, alone)
        assert row.amodal_mask[image == row.id].all()
        assert row.fraction_in_frame == pytest.approx(alone.sum() / row.amodal_pixels)
    hidden = table(Stage([plate(1.0, 1.0)], [PlacedMesh(0, [pose((0, 0, 4))])]))[0]
    assert not hidden.amodal_mask.any()


def test_given_instance_buffer_is_not_rendered_again() -> None:
    stage = Stage([plate(2.0, 2.0)], [PlacedMesh(0, [pose((0, 0, -4))])])
    image = np.zeros((SIZE, SIZE), np.int32)
    image[10:20, 30:50], image[0, 0] = 1, 9  # 9: an id without a row
    rows = Measurer(stage.scene).table(stage.placement, VIEW, [State(1, "thing")], image)
    image[...] = 0
    assert rows[0].visible_pixels == 200
    assert rows[0].visible_box == (30, 10, 50, 20)


def test_table_without_objects_is_empty() -> None:
    rows = ObjectTable()
    assert len(rows) == 0
    columns = rows.arrays()
    assert columns["position"].shape == (0, 3)
    assert all(len(column) == 0 for column in columns.values())


def test_pickled_table_keeps_measurements() -> None:
    rows = table(Stage([plate(2.0, 2.0)], [PlacedMesh(0, [pose((2, 0, -4))])]))
    for twin in (pickle.loads(pickle.dumps(rows)), copy.deepcopy(rows)):
        assert list(twin) == list(rows)
        for name, column in rows.columns().items():
            np.testing.assert_array_equal(twin.columns()[name], column, name)


def test_objects_are_measured_while_no_other_thread_renders() -> None:
    """The scene is placed for a measurement: pixels of a frame that is being rendered would change."""
    seen = table(Stage([plate(4.0, 0.5)], [PlacedMesh(0, [pose((0, 0, -2))])])).by_id(1)
    found: list[int] = []
    reader = threading.Thread(target=lambda: found.append(seen.amodal_pixels))

    @runtime.one_thread_at_a_time
    def render() -> None:
        reader.start()
        reader.join(0.2)
        assert not found
        assert seen.visible_pixels == 100 * 100  # the thread that renders does not wait for the reader

    render()
    reader.join(10.0)
    assert found == [seen.amodal_pixels]
