# SPDX-License-Identifier: Apache-2.0
"""Category ids agree between scenes; a stream can number selected categories instead."""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest

import tiscene as ts
from tiscene.catalog import FIRST_UNREGISTERED_ID
from tiscene.errors import ArgumentError, StageWarning
from tiscene.export import export

SETTINGS = {"width": 32, "height": 24, "buffers": ("instance", "semantic")}
SELECTED = ("sphere", "chair", "wall")


def template(folder: Path, name: str, label: str) -> None:
    path = folder / "templates" / name / "template.usda"
    path.parent.mkdir(parents=True)
    path.write_text(
        f'#usda 1.0\n(\n    defaultPrim = "Model"\n    metersPerUnit = 1\n)\ndef Xform "Model" (\n'
        '    kind = "component"\n    prepend apiSchemas = ["SemanticsLabelsAPI:class"]\n)\n{\n'
        f'    token[] semantics:labels:class = ["{label}"]\n    def Cube "Box" {{}}\n}}\n'
    )


def ids_by_instance(frame: ts.Frame) -> dict[int, set[int]]:
    return {each: set(frame.semantic[frame.instance == each].tolist()) for each in np.unique(frame.instance).tolist()}


def assert_semantic_is_that_of_the_objects(frame: ts.Frame) -> None:
    expected = {0: {0}} | {row.id: {row.category_id} for row in frame.objects}
    for instance, found in ids_by_instance(frame).items():
        assert found == expected[instance]


def test_ids_of_shipped_categories_are_the_same_in_all_scenes():
    ids = ts.categories()
    for scene in ("solid_benchmark", "object_view"):
        stream = ts.Stream(ts.Scenario(scene, [ts.Object("chair", "Chair 01", (0, 0.5, -1))]), **SETTINGS)
        frame = stream[0]
        assert frame.categories == stream.categories
        assert all(ids[name] == number for number, name in frame.categories.items() if number)
        assert frame.objects.by_name("chair").category_id == ids["chair"]
        assert_semantic_is_that_of_the_objects(frame)
        stream.world.spawn("Ball 01")
        assert {row.category: row.category_id for row in stream[0].objects}["ball"] == ids["ball"]
    assert ids["cube"] in ts.Stream("solid_benchmark", **SETTINGS).categories


def test_other_categories_get_ids_above_the_registered_ones(tmp_path, monkeypatch):
    template(tmp_path, "robot_01", "robot")
    template(tmp_path, "lift_01", "lift")
    monkeypatch.setenv("TISCENE_PATH", str(tmp_path))
    objects = [ts.Object("b", "Lift 01"), ts.Object("a", "Robot 01"), ts.Object("c", "Chair 01")]
    frame = ts.Stream(ts.Scenario("object_view", objects), **SETTINGS)[0]
    assert [row.category_id for row in frame.objects if row.template] == [
        FIRST_UNREGISTERED_ID,
        FIRST_UNREGISTERED_ID + 1,
        ts.categories()["chair"],
    ]
    assert_semantic_is_that_of_the_objects(frame)


def test_selected_categories_have_dense_ids_and_all_others_zero():
    stream = ts.Stream("solid_benchmark", categories=SELECTED, **SETTINGS)
    frame = stream[0]
    assert frame.categories == stream.categories == {0: "", 1: "sphere", 2: "chair", 3: "wall"}
    assert {row.category: row.category_id for row in frame.objects} == {
        **dict.fromkeys(("cube", "cylinder", "floor", "ceiling", "ceiling lamp"), 0),
        "sphere": 1,
        "wall": 3,
    }
    assert set(np.unique(frame.semantic)) == {0, 1, 3}
    assert_semantic_is_that_of_the_objects(frame)
    stream.world.spawn("Chair 01", (0, 0.5, 0))
    assert stream[0].objects[-1].category_id == 2


def test_selection_is_a_setting_that_survives_pickling_and_restart():
    stream = ts.Stream("solid_benchmark", categories=list(SELECTED), **SETTINGS)
    plain = ts.Stream("solid_benchmark", **SETTINGS)
    assert stream.settings()["categories"] == list(SELECTED)
    assert plain.settings()["categories"] is None
    assert json.loads(json.dumps(stream.state_dict())) == stream.state_dict()
    with pytest.raises(ArgumentError, match=r"categories: \['sphere'.* there, None here.*Pass the saved categories"):
        plain.load_state_dict(stream.state_dict())
    sent = pickle.loads(pickle.dumps(stream))
    assert sent.settings() == stream.settings()
    assert sent.categories == stream.categories
    np.testing.assert_array_equal(sent[0].semantic, stream[0].semantic)
    stream.restart(ts.Scenario("object_view", [ts.Object("ball", "Sphere")]))
    assert stream[0].objects[-1].category_id == 1
    assert stream.categories == sent.categories


def test_manifest_of_an_export_names_the_selected_categories(tmp_path):
    stream = ts.Stream("solid_benchmark", categories=SELECTED, **SETTINGS)
    export(stream, tmp_path, format="npz", frames=[0])
    manifest = json.loads((tmp_path / "tiscene.json").read_text())
    assert manifest["categories"] == {"0": "", "1": "sphere", "2": "chair", "3": "wall"}
    assert manifest["settings"]["categories"] == list(SELECTED)


def test_unknown_categories_are_named_and_repeated_ones_refused(tmp_path, monkeypatch):
    with pytest.warns(StageWarning, match=r"nothing here is 'spher'; did you mean 'sphere'\?"):
        ts.Stream("solid_benchmark", categories=("wall", "spher"), **SETTINGS)
    with pytest.raises(ArgumentError, match="categories: 'wall' is named twice"):
        ts.Stream("solid_benchmark", categories=("wall", "sphere", "wall"), **SETTINGS)
    template(tmp_path, "robot_01", "robot")
    monkeypatch.setenv("TISCENE_PATH", str(tmp_path))
    assert ts.Stream("solid_benchmark", categories=("robot",), **SETTINGS).categories == {0: "", 1: "robot"}


def test_categories_of_a_frame_that_is_kept_do_not_grow():
    stream = ts.Stream("object_view", width=8, height=6, buffers=("semantic",))
    frame = stream[0]
    stream.world.spawn("Chair 01", (0, 0, -3))
    assert "chair" in stream.categories.values()
    assert "chair" not in frame.categories.values()
