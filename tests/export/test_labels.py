# SPDX-License-Identifier: Apache-2.0
"""The JSON file of a frame: camera and objects."""

import json
from dataclasses import replace

import numpy as np

from tests.export.fake_stream import FakeStream
from tiscene.export import export, frame_json
from tiscene.frame.events import Event
from tiscene.frame.object_table import ObjectTable


def test_the_camera_is_there_and_the_objects_when_asked_for(tmp_path):
    for objects in (False, True):
        folder = tmp_path / str(objects)
        export(FakeStream(("rgb",)), folder, frames=[2], objects=objects)
        content = json.loads((folder / "labels" / "000002.json").read_text())
        assert content["index"] == 2
        assert content["time"] == 0.08
        assert ("objects" in content) == objects
        camera = FakeStream()[2].camera
        np.testing.assert_array_equal(content["camera"]["K"], camera.K)
        np.testing.assert_array_equal(content["camera"]["world_from_camera"], camera.world_from_camera)


def test_what_happened_is_told():
    frame = replace(FakeStream()[1], events=(Event("contact", 3, other=7), Event("contact", 3, surface="left")))
    assert frame_json.frame_labels(frame, objects=False)["events"] == [
        {"kind": "contact", "object": 3, "other": 7, "wall": ""},
        {"kind": "contact", "object": 3, "other": 0, "wall": "left"},
    ]


def test_a_row_has_every_column_and_null_for_none():
    frame = FakeStream()[0]
    (row,) = frame_json.frame_labels(frame, objects=True)["objects"]
    assert list(row) == [*ObjectTable().columns(), "parts"]
    assert row["parts"] == ["Seat", "Back"]
    assert row["name"] == "chair"
    assert row["visible_box"] == [1.0, 2.0, 4.0, 5.0]
    assert row["amodal_box"] is None
    assert row["last_frame"] is None
    assert row["fraction_visible"] == 0.5
    assert row["world_bounds"] == [0.5, 0.0, -0.5, 1.5, 1.0, 0.5]
