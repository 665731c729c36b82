# SPDX-License-Identifier: Apache-2.0
"""Scenes and templates are found by name on the search path."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from pxr import Sdf

from tiscene import catalog
from tiscene.catalog import SceneEntry, TemplateEntry
from tiscene.errors import ArgumentError, MissingFile, SceneNotFound, StageError, TemplateNotFound
from tiscene.usd.read.template import read_template


def touch(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("#usda 1.0\n")
    return path


@pytest.fixture
def shelf(tmp_path, monkeypatch):
    """Put two folders of scenes on the search path; both have a scene `kitchen`."""
    first, second = tmp_path / "first", tmp_path / "second"
    touch(first / "kitchen" / "scene.usda")
    touch(first / "templates" / "chair_77" / "template.usda")
    touch(second / "kitchen" / "scene.usda")
    touch(second / "attic" / "scene.usdc")
    touch(second / "notes" / "readme.txt")
    monkeypatch.setenv("TISCENE_PATH", os.pathsep.join([str(first), "", str(second)]))
    return first, second


def test_scenes_lists_folders_with_a_stage_and_the_first_folder_of_a_name_wins(shelf):
    first, second = shelf
    scenes = catalog.scenes()
    assert scenes["kitchen"] == SceneEntry("kitchen", first / "kitchen" / "scene.usda")
    assert scenes["attic"] == SceneEntry("attic", second / "attic" / "scene.usdc")
    assert not {"notes", "templates", "author"} & set(scenes)
    assert list(scenes) == sorted(scenes)
    assert catalog.find_scene("attic") == scenes["attic"].path


def test_template_is_named_after_its_folder(shelf):
    first, _ = shelf
    path = first / "templates" / "chair_77" / "template.usda"
    assert catalog.templates()["Chair 77"] == TemplateEntry("Chair 77", path)
    assert catalog.find_template("Chair 77") == path
    assert [catalog.template_name(folder) for folder in ("cube", "remote_controller_01", "cube_x_trail")] == [
        "Cube",
        "Remote Controller 01",
        "Cube X Trail",
    ]


def test_categories_of_shipped_templates_are_registered():
    ids = catalog.categories()
    assert {entry.category for entry in catalog.templates().values()} <= set(ids)
    assert list(ids.values()) == list(range(1, len(ids) + 1))
    ids.clear()
    assert catalog.categories()


def test_category_of_every_shipped_template_is_that_of_the_objects_made_of_it():
    for entry in catalog.templates().values():
        assert entry.category == read_template(entry.path).category != ""


CHAIR = """#usda 1.0
(
    defaultPrim = "Chair"
)
def Xform "Chair" (prepend apiSchemas = ["SemanticsLabelsAPI:class"]) {
    token[] semantics:labels:class = ["armchair"]
    def Cube "Seat" {}
}
"""


@pytest.mark.parametrize(
    ("replaced", "replacement", "category"),
    [
        ("", "", "armchair"),
        ("labels:class", "labels:other", ""),  # no API schema for the taxonomy of that label
        ("LabelsAPI:class", "LabelsAPI:other", ""),
        ('["SemanticsLabelsAPI:class"]', '["SemanticsLabelsAPI:class", "SemanticsLabelsAPI:a"]', "armchair"),
        ('["armchair"]', '["sofa", "armchair"]', "sofa"),
        ("class", "category", "armchair"),
    ],
)
def test_category_is_the_label_that_usd_reads(tmp_path, monkeypatch, replaced, replacement, category):
    path = touch(tmp_path / "templates" / "chair" / "template.usda")
    path.write_text(CHAIR.replace(replaced, replacement) if replaced else CHAIR)
    monkeypatch.setenv("TISCENE_PATH", str(tmp_path))
    assert catalog.templates()["Chair"].category == read_template(path).category == category


def test_category_of_a_binary_file_and_of_a_changed_file(tmp_path, monkeypatch):
    path = touch(tmp_path / "templates" / "chair" / "template.usda")
    path.write_text(CHAIR)
    monkeypatch.setenv("TISCENE_PATH", str(tmp_path))
    chair = catalog.templates()["Chair"]
    assert chair.category == "armchair"
    path.write_text(CHAIR.replace("armchair", "stool"))
    assert chair.category == "stool"
    Sdf.Layer.FindOrOpen(str(path)).Export(str(path.with_suffix(".usdc")))
    path.unlink()
    chair = catalog.templates()["Chair"]
    assert chair.path.suffix == ".usdc"
    assert chair.category == "stool"


def test_category_of_a_damaged_file_raises_stage_error(shelf):
    with pytest.raises(StageError):
        catalog.templates()["Chair 77"].category  # noqa: B018


def test_listing_scenes_and_shipped_templates_imports_neither_usd_nor_taichi(monkeypatch):
    monkeypatch.delenv("TISCENE_PATH", raising=False)
    program = (
        "import sys, tiscene as ts\n"
        "assert 'chair' in {entry.category for entry in ts.templates().values()} and ts.scenes()\n"
        "print(*sys.modules)"
    )
    modules = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    assert not {"taichi", "pxr", "numpy"} & set(modules)


def test_variants_follow_a_template_name_in_braces(shelf):
    assert catalog.template_variants("Chair 77") == ("Chair 77", {})
    assert catalog.template_variants("Chair 77{color=red}") == ("Chair 77", {"color": "red"})
    two = catalog.template_variants("a/b.usda{color=red}{appearance=primitives}")
    assert two == ("a/b.usda", {"color": "red", "appearance": "primitives"})
    assert catalog.find_template("Chair 77{color=red}") == catalog.find_template("Chair 77")
    assert not catalog.is_prim_path("/a/b.usda{color=red}")


@pytest.mark.parametrize(
    "name", ["Chair 77{", "Chair 77{color}", "Chair 77{=red}", "Chair 77{a=b}}", "Chair 77{a=b} c"]
)
def test_malformed_variants_raise_argument_error(shelf, name):
    with pytest.raises(ArgumentError, match="color=walnut"):
        catalog.find_template(name)


def test_search_path_is_the_package_without_tiscene_path(monkeypatch):
    monkeypatch.delenv("TISCENE_PATH", raising=False)
    assert [folder.name for folder in catalog.search_path()] == ["usd_scenes"]


@pytest.mark.parametrize("name", ["mine.usda", "mine.usd", "mine.usdc", "mine.usdz", "run.json", "MINE.USDA"])
def test_find_scene_returns_the_path_of_an_existing_file(tmp_path, monkeypatch, name):
    path = touch(tmp_path / name)
    assert catalog.find_scene(path) == path
    assert catalog.find_scene(str(path)) == path
    monkeypatch.chdir(tmp_path)
    assert catalog.find_scene(name) == Path(name)


def test_unknown_scene_suggests_the_nearest_name_and_missing_folders(shelf, monkeypatch):
    with pytest.raises(SceneNotFound, match=r"no scene 'kitchn'\. Did you mean 'kitchen'\? `tiscene list` lists all"):
        catalog.find_scene("kitchn")
    with pytest.raises(SceneNotFound, match=r"no scene ''\. .*`tiscene list` lists all"):
        catalog.find_scene("")
    with pytest.raises(SceneNotFound, match=r"Did you mean 'kitchen'"):
        catalog.find_scene("KITCHN")
    monkeypatch.setenv("TISCENE_PATH", "/no/such/shelf")
    with pytest.raises(SceneNotFound, match=r"TISCENE_PATH names folders that do not exist: /no/such/shelf"):
        catalog.find_scene("kitchen")


def test_unknown_template_suggests_the_nearest_name_and_the_command_that_lists_all(shelf):
    count = len(catalog.templates())
    with pytest.raises(TemplateNotFound) as caught:
        catalog.find_template("Chair 7", scene="kitchen")
    assert str(caught.value) == (
        f"no template 'Chair 7' in scene 'kitchen'. Did you mean 'Chair 77'? `tiscene show kitchen` lists all {count}."
    )
    with pytest.raises(TemplateNotFound, match="`tiscene list`"):
        catalog.find_template("chair_77")


def test_unreadable_folders_on_the_search_path_are_skipped(shelf, monkeypatch):
    """For example a folder of another user."""
    original = os.stat

    def stat(path, *rest, **named):
        if "private" in os.fspath(path):
            raise PermissionError(13, "Permission denied", path)
        return original(path, *rest, **named)

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
def test_missing_file_raises_missing_file(tmp_path, monkeypatch, missing):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MissingFile, match=r"no file '.*gone"):
        catalog.find_scene(missing)


def test_path_of_a_prim_is_no_template_file():
    with pytest.raises(MissingFile, match=r"no file '/World/Chair'; .*`world.move`"):
        catalog.find_template("/World/Chair")


def test_folder_or_file_of_another_type_raises_argument_error(tmp_path):
    with pytest.raises(ArgumentError, match=r"is a folder; expected a file with the suffix \.usda"):
        catalog.find_scene(tmp_path)
    with pytest.raises(ArgumentError, match=r"is a \.txt file"):
        catalog.find_scene(touch(tmp_path / "x.txt"))
    with pytest.raises(ArgumentError, match=r"is a \.json file"):
        catalog.find_template(touch(tmp_path / "x.json"))


def test_unchanged_folders_are_listed_once_and_changed_ones_again(shelf, monkeypatch):
    first, _ = shelf
    folders = [first / "templates" / "chair_77", first / "templates"]
    for folder in folders:
        os.utime(folder, (1e9, 1e9))  # as if nothing had changed for years
    reads = []
    listdir = os.listdir
    monkeypatch.setattr(os, "listdir", lambda folder: (reads.append(Path(folder)), listdir(folder))[1])
    for _ in range(3):
        assert "Chair 77" in catalog.templates()
    assert reads.count(first / "templates") == 1
    touch(first / "templates" / "chair_78" / "template.usda")
    assert catalog.find_template("Chair 78") == first / "templates" / "chair_78" / "template.usda"
    os.remove(first / "templates" / "chair_77" / "template.usda")
    assert "Chair 77" not in catalog.templates()


def test_folders_that_have_just_changed_are_listed_each_time(shelf, monkeypatch):
    first, _ = shelf
    time = os.stat(first / "templates").st_mtime_ns
    assert "Chair 77" in catalog.templates()
    touch(first / "templates" / "chair_79" / "template.usda")
    os.utime(first / "templates", ns=(time, time))  # within the resolution of the file system's clock
    assert "Chair 79" in catalog.templates()
