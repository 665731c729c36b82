# SPDX-License-Identifier: Apache-2.0
"""Names to files."""

import os
from pathlib import Path

import pytest

from tiscene import catalog
from tiscene.errors import ArgumentError, MissingFile, SceneNotFound, TemplateNotFound


def touch(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("#usda 1.0\n")
    return path


@pytest.fixture
def shelf(tmp_path, monkeypatch):
    """Two folders of scenes on the search path; the first one hides a scene of the second."""
    first, second = tmp_path / "first", tmp_path / "second"
    touch(first / "kitchen" / "scene.usda")
    touch(first / "templates" / "chair_77" / "template.usda")
    touch(second / "kitchen" / "scene.usda")
    touch(second / "attic" / "scene.usdc")
    touch(second / "notes" / "readme.txt")
    monkeypatch.setenv("TISCENE_PATH", os.pathsep.join([str(first), "", str(second)]))
    return first, second


def test_user_folders_come_first_and_only_folders_with_a_stage_count(shelf):
    first, second = shelf
    scenes = catalog.scenes()
    assert scenes["kitchen"] == first / "kitchen" / "scene.usda"
    assert scenes["attic"] == second / "attic" / "scene.usdc"
    assert not {"notes", "templates", "author"} & set(scenes)
    assert list(scenes) == sorted(scenes)
    assert catalog.find_scene("attic") == scenes["attic"]


def test_template_names_come_from_their_folders(shelf):
    first, _ = shelf
    assert catalog.templates()["Chair 77"] == first / "templates" / "chair_77" / "template.usda"
    assert catalog.find_template("Chair 77") == catalog.templates()["Chair 77"]
    assert [catalog.template_name(folder) for folder in ("cube", "remote_controller_01", "cube_x_trail")] == [
        "Cube",
        "Remote Controller 01",
        "Cube X Trail",
    ]


def test_variants_are_chosen_after_a_template_name(shelf):
    assert catalog.template_variants("Chair 77") == ("Chair 77", {})
    assert catalog.template_variants("Chair 77{color=red}") == ("Chair 77", {"color": "red"})
    two = catalog.template_variants("a/b.usda{color=red}{appearance=primitives}")
    assert two == ("a/b.usda", {"color": "red", "appearance": "primitives"})
    assert catalog.find_template("Chair 77{color=red}") == catalog.find_template("Chair 77")
    assert not catalog.is_prim_path("/a/b.usda{color=red}")


@pytest.mark.parametrize(
    "name", ["Chair 77{", "Chair 77{color}", "Chair 77{=red}", "Chair 77{a=b}}", "Chair 77{a=b} c"]
)
def test_braces_that_choose_nothing_are_refused(shelf, name):
    with pytest.raises(ArgumentError, match="color=walnut"):
        catalog.find_template(name)


def test_the_package_is_searched_without_any_setting(monkeypatch):
    monkeypatch.delenv("TISCENE_PATH", raising=False)
    assert [folder.name for folder in catalog.search_path()] == ["usd_scenes"]


@pytest.mark.parametrize("name", ["mine.usda", "mine.usd", "mine.usdc", "mine.usdz", "run.json", "MINE.USDA"])
def test_paths_pass_through(tmp_path, monkeypatch, name):
    path = touch(tmp_path / name)
    assert catalog.find_scene(path) == path
    assert catalog.find_scene(str(path)) == path
    monkeypatch.chdir(tmp_path)
    assert catalog.find_scene(name) == Path(name)


def test_unknown_scene_names_the_nearest_and_the_way_on(shelf, monkeypatch):
    with pytest.raises(SceneNotFound, match=r"no scene 'kitchn'\. Did you mean 'kitchen'\? `tiscene list` lists all"):
        catalog.find_scene("kitchn")
    monkeypatch.setenv("TISCENE_PATH", "/no/such/shelf")
    with pytest.raises(SceneNotFound, match=r"TISCENE_PATH names folders that do not exist: /no/such/shelf"):
        catalog.find_scene("kitchen")


def test_unknown_template_names_the_nearest_and_the_way_on(shelf):
    count = len(catalog.templates())
    with pytest.raises(TemplateNotFound) as caught:
        catalog.find_template("Chair 7", scene="kitchen")
    assert str(caught.value) == (
        f"no template 'Chair 7' in scene 'kitchen'. Did you mean 'Chair 77'? `tiscene show kitchen` lists all {count}."
    )
    with pytest.raises(TemplateNotFound, match="`tiscene list`"):
        catalog.find_template("chair_77")


def test_what_cannot_be_looked_into_is_passed_over(shelf, monkeypatch):
    """As another user's folder on the search path is."""
    looked = os.stat

    def stat(path, *rest, **named):
        if "private" in os.fspath(path):
            raise PermissionError(13, "Permission denied", path)
        return looked(path, *rest, **named)

    monkeypatch.setenv(
        "TISCENE_PATH", os.pathsep.join(["/private", "~nobody-here/x", *map(str, catalog.search_path())])
    )
    monkeypatch.setattr(os, "stat", stat)
    assert "kitchen" in catalog.scenes()
    with pytest.raises(SceneNotFound, match="folders that do not exist: /private, ~nobody-here/x"):
        catalog.find_scene("kitchn")


@pytest.mark.parametrize(
    "missing", ["gone.usda", "folder/gone", "gone.json", "~nobody-here/gone.usda", f"{'x' * 5000}gone.usda"]
)
def test_missing_file(tmp_path, monkeypatch, missing):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MissingFile, match=r"no file '.*gone"):
        catalog.find_scene(missing)


def test_a_thing_of_the_stage_is_no_template():
    with pytest.raises(MissingFile, match=r"no file '/World/Chair'; .*`world.move`"):
        catalog.find_template("/World/Chair")


def test_folder_and_wrong_kind_of_file(tmp_path):
    with pytest.raises(ArgumentError, match=r"is a folder; expected a file that ends in \.usda"):
        catalog.find_scene(tmp_path)
    with pytest.raises(ArgumentError, match=r"is a \.txt file"):
        catalog.find_scene(touch(tmp_path / "x.txt"))
    with pytest.raises(ArgumentError, match=r"is a \.json file"):
        catalog.find_template(touch(tmp_path / "x.json"))
