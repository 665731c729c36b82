# SPDX-License-Identifier: Apache-2.0
"""The JSON file of a frame: camera, events and objects."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tests.export.fake_stream import CHAIR, FakeStream
from tiscene.errors import ArgumentError
from tiscene.export import export, frame_json
from tiscene.frame.events import Event
from tiscene.frame.measurements import OrientedBox
from tiscene.frame.object_table import ObjectTable
from tiscene.scene.camera import Camera


def test_labels_have_the_camera_and_the_objects_if_requested(tmp_path):
    for objects in (None, "all"):
        folder = tmp_path / str(objects)
        export(FakeStream(("rgb",)), folder, frames=[2], objects=objects)
        content = json.loads((folder / "labels" / "000002.json").read_text())
        assert content["index"] == 2
        assert content["time"] == 0.08
        assert ("objects" in content) == (objects is not None)
        camera = FakeStream()[2].camera
        np.testing.assert_array_equal(content["camera"]["K"], camera.K)
        np.testing.assert_array_equal(content["camera"]["world_from_camera"], camera.world_from_camera)
        assert content["camera"]["projection"] == "perspective"


def test_labels_tell_that_a_camera_is_orthographic():
    stream = FakeStream(("rgb",))
    stream.camera = Camera(orthographic_height=2.0)
    assert frame_json.frame_labels(stream[1], objects=None)["camera"]["projection"] == "orthographic"


def test_events_have_the_fields_of_event():
    frame = replace(FakeStream()[1], events=(Event("contact", 3, other=7), Event("contact", 3, surface="left")))
    assert frame_json.frame_labels(frame, objects=None)["events"] == [
        {"kind": "contact", "object": 3, "other": 7, "surface": "", "room": ""},
        {"kind": "contact", "object": 3, "other": 0, "surface": "left", "room": ""},
    ]


def test_object_row_has_every_column_and_null_for_none():
    frame = FakeStream()[0]
    (row,) = frame_json.frame_labels(frame, objects="all")["objects"]
    assert list(row) == [*ObjectTable().arrays(), "parts"]
    assert row["parts"] == ["Seat", "Back"]
    assert row["name"] == "chair"
    assert row["visible_box"] == [1.0, 2.0, 4.0, 5.0]
    assert row["amodal_box"] is None
    assert row["last_frame"] is None
    assert row["fraction_visible"] == 0.5
    assert row["world_bounds"] == [0.5, 0.0, -0.5, 1.5, 1.0, 0.5]


def test_objects_selects_moving_or_visible_or_all_rows():
    still = {"template": "", "velocity": (0.0, 0.0, 0.0)}
    rows = {"spawned": {"velocity": (0.0, 0.0, 0.0)}, "playing": {"template": ""}, "hidden": still, "seen": still}
    states = [replace(CHAIR, id=k, name=name, **row) for k, (name, row) in enumerate(rows.items())]
    measured = SimpleNamespace(
        visible_pixels=np.array([0, 3, 0, 1]),
        pixels_in_frame=np.full(4, 3),
        amodal_pixels=np.full(4, 3),
        visible_box=np.zeros((4, 4)),
        amodal_box=np.zeros((4, 4)),
        world_bounds=np.zeros((4, 2, 3)),
        box_3d=[OrientedBox((0, 0, 0), (1, 1, 1), (1, 0, 0, 0))] * 4,
    )
    frame = replace(FakeStream(("rgb",))[0], objects=ObjectTable(states, measured))
    names = {
        selection: [row["name"] for row in frame_json.frame_labels(frame, selection)["objects"]]
        for selection in frame_json.OBJECT_SELECTIONS
    }
    assert names == {"moving": ["spawned", "playing"], "visible": ["playing", "seen"], "all": list(rows)}


def test_unknown_selection_of_objects_raises_argument_error(tmp_path):
    with pytest.raises(ArgumentError, match="objects='some': must be None or one of moving, visible, all"):
        export(FakeStream(("rgb",)), tmp_path, frames=[0], objects="some")
