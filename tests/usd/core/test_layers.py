# SPDX-License-Identifier: Apache-2.0
"""Digests of the files of a stage."""

import hashlib
import shutil

import numpy as np
import pytest
from PIL import Image
from pxr import Sdf, Usd, UsdUtils

from tiscene.usd.core import layers
from tiscene.usd.core.layers import cached_by_layers, layer_digests, layer_state


@pytest.fixture
def room(tmp_path):
    """Return a scene that references chair.usda, which has a texture, and lamp.usda in another variant."""
    folder = tmp_path / "room"
    folder.mkdir()
    Image.fromarray(np.zeros((2, 2, 3), np.uint8)).save(folder / "wood.png")
    for name in ("chair", "lamp"):
        stage = Usd.Stage.CreateNew(str(folder / f"{name}.usda"))
        prim = stage.DefinePrim("/Thing", "Xform")
        stage.SetDefaultPrim(prim)
        if name == "chair":
            prim.CreateAttribute("file", Sdf.ValueTypeNames.Asset).Set("./wood.png")
        stage.Save()
    stage = Usd.Stage.CreateNew(str(folder / "scene.usda"))
    stage.DefinePrim("/Chair").GetReferences().AddReference("./chair.usda")
    variants = stage.DefinePrim("/Lamp").GetVariantSets().AddVariantSet("lighting")
    variants.AddVariant("none")
    variants.AddVariant("lamp")
    variants.SetVariantSelection("lamp")
    with variants.GetVariantEditContext():
        stage.GetPrimAtPath("/Lamp").GetReferences().AddReference("./lamp.usda")
    variants.SetVariantSelection("none")
    stage.Save()
    return folder / "scene.usda"


def test_digests_cover_all_layers_and_textures_by_relative_path(room):
    digests = layer_digests(room)
    assert sorted(digests) == ["chair.usda", "lamp.usda", "scene.usda", "wood.png"]
    assert digests["wood.png"] == hashlib.sha256((room.parent / "wood.png").read_bytes()).hexdigest()


def test_digests_change_with_content_not_with_location(room, tmp_path):
    before = layer_digests(room)
    shutil.copytree(room.parent, tmp_path / "elsewhere")
    copy = tmp_path / "elsewhere" / "scene.usda"
    assert layer_digests(copy) == before
    (tmp_path / "elsewhere" / "wood.png").write_bytes(b"another")
    after = layer_digests(copy)
    assert {name for name in before if after[name] != before[name]} == {"wood.png"}


def test_unchanged_files_are_not_read_again_and_changed_ones_are(room, monkeypatch):
    read = []
    monkeypatch.setattr(layers, "_digest", lambda path: read.append(path.name) or digest(path))
    digest = lambda path: hashlib.sha256(path.read_bytes()).hexdigest()  # noqa: E731
    before = layer_digests(room)
    assert sorted(read) == ["chair.usda", "lamp.usda", "scene.usda", "wood.png"]
    read.clear()
    assert layer_digests(room) == before
    assert read == []
    (room.parent / "wood.png").unlink()
    assert "wood.png" not in layer_digests(room)
    (room.parent / "wood.png").write_bytes(b"another")
    assert layer_digests(room)["wood.png"] == hashlib.sha256(b"another").hexdigest()


def test_missing_texture_is_left_out_of_digests(room):
    (room.parent / "wood.png").unlink()
    assert sorted(layer_digests(room)) == ["chair.usda", "lamp.usda", "scene.usda"]


def test_digests_in_a_folder_with_brackets(room, tmp_path):
    """Brackets in a path also lead into a package."""
    shutil.copytree(room.parent, tmp_path / "room [2]")
    assert layer_digests(tmp_path / "room [2]" / "scene.usda") == layer_digests(room)


def test_package_has_one_digest(room, tmp_path):
    package = tmp_path / "room.usdz"
    assert UsdUtils.CreateNewUsdzPackage(str(room), str(package))
    assert list(layer_digests(package)) == ["room.usdz"]


def test_layer_is_looked_for_again_only_where_it_may_be_found(room, monkeypatch):
    found, search = [], layers._dependencies
    monkeypatch.setattr(layers, "_dependencies", lambda root: found.append(root) or search(root))
    content = (room.parent / "lamp.usda").read_bytes()
    (room.parent / "lamp.usda").unlink()
    missing = layer_state(room)
    (room.parent / "notes.txt").write_text("nothing to do with it")
    assert layer_state(room) == missing
    assert len(found) == 1
    (room.parent / "lamp.usda").write_bytes(content)
    assert layer_state(room) != missing
    assert "lamp.usda" in layer_digests(room)


def test_tile_that_was_missing_is_found(room):
    stage = Usd.Stage.Open(str(room.parent / "chair.usda"))
    stage.GetPrimAtPath("/Thing").GetAttribute("file").Set("./tile.<UDIM>.png")
    stage.Save()
    before = layer_state(room)
    (room.parent / "tile.1001.png").write_bytes(b"tile")
    assert layer_state(room) != before
    assert "tile.1001.png" in layer_digests(room)


def test_digests_include_a_layer_that_cannot_be_read_and_all_others(room):
    before = layer_digests(room)
    (room.parent / "lamp.usda").write_text("#usda 1.0\ndef {")
    after = layer_digests(room)
    assert {name for name in before if after[name] != before[name]} == {"lamp.usda"}
    assert after.keys() == before.keys()


def test_cached_function_is_called_again_once_a_file_has_changed(room):
    @cached_by_layers(2)
    def size(file, name):
        return (file.parent / name).stat().st_size, object()

    first = size(room, "wood.png")
    assert size(room, "wood.png") is first
    assert size(room, "chair.usda") is not first
    (room.parent / "wood.png").write_bytes(b"another")
    assert size(room, "wood.png")[0] == 7
