# SPDX-License-Identifier: Apache-2.0
"""Base images on disk: found again, never mistaken for another, never in the way."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.render.integrators.incremental.test_incremental_pass import AT, BLUE, LAMP, QUALITY, SIZE, Box, stacked
from tests.render.path_scenes import CORNELL, WHITE, ball, box, described, matte
from tiscene.render.integrators.incremental.base_image_cache import BaseImageCache, cache_folder
from tiscene.render.integrators.incremental.incremental_pass import IncrementalPass
from tiscene.scene.description import SceneDescription, Texture, TextureLookup

pytestmark = pytest.mark.usefixtures("taichi")

SETTINGS = {"seed": 1, "spp": 4, "max_depth": 5}
IMAGE = np.arange(24.0, dtype=np.float32).reshape(2, 4, 3)


def test_an_image_is_found_again(tmp_path: Path) -> None:
    images = BaseImageCache(tmp_path / "new" / "folder")
    images.save("a", IMAGE)
    np.testing.assert_array_equal(images.load("a", IMAGE.shape), IMAGE)
    assert BaseImageCache(tmp_path / "new" / "folder").load("b", IMAGE.shape) is None
    assert [path.name for path in images.folder.iterdir()] == ["a.base"]


@pytest.mark.parametrize(
    "damage", [lambda data: data[:-5], lambda data: data[:50] + b"?" + data[51:], lambda data: b""]
)
def test_a_damaged_file_is_no_image(tmp_path: Path, damage: object) -> None:
    images = BaseImageCache(tmp_path)
    images.save("a", IMAGE)
    path = tmp_path / "a.base"
    path.write_bytes(damage(path.read_bytes()))  # type: ignore[operator]
    assert images.load("a", IMAGE.shape) is None
    images.save("a", IMAGE)
    assert images.load("a", IMAGE.shape) is not None
    assert images.load("a", (2, 4, 2)) is None


def test_a_folder_that_cannot_be_written_to(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    images = BaseImageCache(tmp_path / "file")
    images.save("a", IMAGE)
    assert images.load("a", IMAGE.shape) is None


def test_the_folder_stays_small(tmp_path: Path) -> None:
    """What was used longest ago goes first, and what a writer left that died; other files are not ours."""
    size = IMAGE.nbytes + 32
    images = BaseImageCache(tmp_path, size_limit=3 * size)
    (tmp_path / "other.txt").write_text("x" * 10 * size)
    (tmp_path / "died.part").write_bytes(b"x" * size)
    os.utime(tmp_path / "died.part", (0, 0))
    for age, name in enumerate("abc"):
        images.save(name, IMAGE)
        os.utime(tmp_path / f"{name}.base", (1000 + age, 1000 + age))
    images.load("a", IMAGE.shape)
    images.save("d", IMAGE)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.base", "c.base", "d.base", "other.txt"]


def test_the_platforms_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("TISCENE_CACHE", str(tmp_path))
    assert cache_folder() == tmp_path
    monkeypatch.delenv("TISCENE_CACHE")
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "tiscene"


def key_of(scene: Box, **others: int) -> str:
    scene.device.place(scene.at(*AT))
    return BaseImageCache(Path()).key(scene.device, ~scene.moving, scene.view, SETTINGS | others)


def test_a_key_tells_what_matters() -> None:
    scene = Box()
    key = key_of(scene)
    assert key_of(Box()) == key
    scene.placed.world_from_object[:, 0, 0, 3] += 1e-9
    different = {
        "pose": key_of(scene),
        "seed": key_of(Box(), seed=2),
        "lights": key_of(Box(lights="point")),
        "camera": key_of(Box(camera=replace(Box().view.current, lens_radius=0.01))),
        "thing": key_of(Box(wall=BLUE)),
    }
    scene = Box()
    scene.view = replace(scene.view, width=33)
    different["size"] = key_of(scene)
    scene = Box()
    scene.device.add(described([ball((0, 0, 0), 1.0)], [matte("white", WHITE)]))  # another template, not placed
    assert key_of(scene) == key
    assert len({key, *different.values()}) == 1 + len(different), different


def test_a_key_tells_textures_and_materials() -> None:
    def keyed(description: SceneDescription) -> str:
        scene = Box()
        scene.device.descriptions[0] = (0, description)
        return key_of(scene)

    meshes, materials = box(CORNELL)
    painted = [matte("painted", TextureLookup(0)), *materials[1:]]
    black, white = (Texture("t", np.full((4, 4, 4), value, np.uint8)) for value in (0, 255))
    keys = [
        keyed(described(meshes, materials, [LAMP])),
        keyed(described(meshes, painted, [LAMP], [black])),
        keyed(described(meshes, painted, [LAMP], [white])),
        keyed(described(meshes, painted, [LAMP], [replace(white, encoding="raw")])),
    ]
    assert len(set(keys)) == 4


def test_a_kept_base_gives_the_same_picture(tmp_path: Path) -> None:
    """And is not rendered again: of a file with other pixels, the picture shows those."""
    images = BaseImageCache(tmp_path)
    scene = Box()
    plain = stacked(scene.replay(*AT))
    for _ in range(2):
        scene.passes = IncrementalPass(scene.device, *SIZE, images=images)
        np.testing.assert_array_equal(stacked(scene.replay(*AT)), plain)
    (path,) = tmp_path.iterdir()
    images.save(path.stem, np.full((SIZE[1], SIZE[0], 9), 7.0, np.float32))
    scene.passes = IncrementalPass(scene.device, *SIZE, images=images)
    assert (scene.replay().hdr == 7.0).all()
    assert QUALITY["spp"] == scene.passes.cached_spp
