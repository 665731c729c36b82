# SPDX-License-Identifier: Apache-2.0
"""Relative paths in JSON files count from the file's folder, else from the working directory."""

import json
import shutil
import warnings

import pytest

from tiscene import catalog
from tiscene.errors import MissingFile, StageWarning
from tiscene.export.generation.recipe import Recipe
from tiscene.learning.course import Course
from tiscene.learning.phase import Phase
from tiscene.scenario.edits import Spawn
from tiscene.scenario.objects import Object
from tiscene.scenario.scenario import Scenario


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a folder in the working directory, with a scenario of a scene and templates beside it."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "mine"
    folder.mkdir()
    objects = [Object("a", "ball.usda{color=red}"), Object("b", "Cube"), Object("c", "/World/Box")]
    Scenario("room.usda", objects, edits=[Spawn(0, Object("d", "models/ball.usda"))]).save(folder / "scenario.json")
    return folder


def place(*paths, content=""):
    for path in paths:
        path.parent.mkdir(exist_ok=True)
        path.write_text(f"#usda 1.0\n{content}")


def test_files_beside_the_scenario_are_found_and_others_in_the_working_directory(folder):
    place(folder / "room.usda", folder / "models" / "ball.usda")
    found = Scenario.load("mine/scenario.json")
    assert found.scene == "mine/room.usda"
    assert [each.template for each in found.objects] == ["ball.usda{color=red}", "Cube", "/World/Box"]
    assert found.edits[0].object.template == "mine/models/ball.usda"
    place(folder / "ball.usda")
    assert Scenario.load("mine/scenario.json").objects[0].template == "mine/ball.usda{color=red}"
    assert Scenario.load(folder / "scenario.json").scene == str(folder / "room.usda")


def test_files_of_the_working_directory_keep_their_names(folder, monkeypatch):
    """As exports have recorded them, which are continued."""
    place(folder.parent / "room.usda")
    assert Scenario.load(folder / "scenario.json").scene == "room.usda"
    place(folder / "room.usda")
    monkeypatch.chdir(folder)
    assert Scenario.load(folder / "scenario.json").scene == "room.usda"
    assert Scenario.load("scenario.json").scene == "room.usda"


def test_other_file_in_the_working_directory_is_named(folder):
    place(folder / "room.usda", folder.parent / "room.usda")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Scenario.load("mine/scenario.json")
    place(folder.parent / "room.usda", content="# other")
    with pytest.warns(StageWarning, match=r"'room\.usda' is in 'mine', .* working directory, with another content"):
        assert Scenario.load("mine/scenario.json").scene == "mine/room.usda"


def test_missing_file_is_an_error_as_before(folder):
    with pytest.raises(MissingFile, match=r"no file 'room\.usda' \(working directory: "):
        catalog.find_scene(Scenario.load("mine/scenario.json").scene)


def test_recipes_and_courses_find_files_beside_them(folder):
    place(folder / "room.usda", folder / "ball.usda")
    recipe = {
        "scenes": ["room.usda", {"scene": "room.usda", "ranges": {"templates": ["ball.usda{size=2}"]}}, "room_02"],
        "ranges": {"templates": ["Cube", "ball.usda"], "clutter": {"templates": ["ball.usda"]}},
    }
    (folder / "recipe.json").write_text(json.dumps(recipe))
    found = Recipe.load("mine/recipe.json").to_json()
    assert [each["scene"] for each in found["scenes"]] == ["mine/room.usda", "mine/room.usda", "room_02"]
    assert found["scenes"][1]["ranges"] == {"templates": ["mine/ball.usda{size=2}"]}
    assert found["ranges"] == {"templates": ["Cube", "mine/ball.usda"], "clutter": {"templates": ["mine/ball.usda"]}}
    shutil.copy(catalog.find_scene("object_view"), folder / "room.usda")
    course = Course([Phase("one", Scenario("object_view"), frames=2)], width=8, height=6).to_json()
    (name,) = course["scenarios"]
    course["scenarios"][name]["scene"] = "room.usda"
    (folder / "course.json").write_text(json.dumps(course))
    assert Course.load("mine/course.json").phases[0].scenario.scene == "mine/room.usda"
