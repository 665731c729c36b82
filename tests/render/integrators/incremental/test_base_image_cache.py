# SPDX-License-Identifier: Apache-2.0
"""The disk cache of base images: round trip, keys, corrupt files, size limit."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.render.incremental_scenes import BALLS, BLUE, LAMP, QUALITY, SIZE, MovingBalls, stacked
from tests.render.path_scenes import CORNELL, WHITE, ball, box, described, matte
from tiscene.files import cache_folder
from tiscene.render.integrators.incremental.base_image_cache import BaseImageCache, _program_digest, content_digest
from tiscene.render.integrators.incremental.incremental_pass import IncrementalPass
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.scene.description import SceneDescription, Texture, TextureLookup

SETTINGS = {"seed": 1, "spp": 4, "max_depth": 5}
IMAGE = np.arange(24.0, dtype=np.float32).reshape(2, 4, 3)


def test_saved_image_is_loaded_and_unknown_key_is_not(tmp_path: Path) -> None:
    images = BaseImageCache(tmp_path / "new" / "folder")
    images.save("a", IMAGE)
    np.testing.assert_array_equal(images.load("a", IMAGE.shape), IMAGE)
    assert BaseImageCache(tmp_path / "new" / "folder").load("b", IMAGE.shape) is None
    assert [path.name for path in images.folder.iterdir()] == ["a.base"]


@pytest.mark.parametrize(
    "damage", [lambda data: data[:-5], lambda data: data[:50] + b"?" + data[51:], lambda data: b""]
)
def test_corrupt_file_is_not_loaded_and_can_be_replaced(tmp_path: Path, damage: object) -> None:
    images = BaseImageCache(tmp_path)
    images.save("a", IMAGE)
    path = tmp_path / "a.base"
    path.write_bytes(damage(path.read_bytes()))  # type: ignore[operator]
    assert images.load("a", IMAGE.shape) is None
    images.save("a", IMAGE)
    assert images.load("a", IMAGE.shape) is not None
    assert images.load("a", (2, 4, 2)) is None


def test_unwritable_folder_is_only_warned_of(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    images = BaseImageCache(tmp_path / "file")
    with pytest.warns(UserWarning, match=r"/file': File exists\. Name another folder by .* TISCENE_CACHE"):
        images.save("a", IMAGE)
    assert images.load("a", IMAGE.shape) is None


def test_size_limit_deletes_least_recently_used_files(tmp_path: Path) -> None:
    """Leftovers of crashed writers are deleted too; files of other kinds are neither counted nor deleted."""
    size = IMAGE.nbytes + 32
    images = BaseImageCache(tmp_path, size_limit=3 * size)
    (tmp_path / "other.txt").write_text("x" * 10 * size)
    (tmp_path / "crashed.part").write_bytes(b"x" * size)
    os.utime(tmp_path / "crashed.part", (0, 0))
    for age, name in enumerate("abc"):
        images.save(name, IMAGE)
        os.utime(tmp_path / f"{name}.base", (1000 + age, 1000 + age))
    images.load("a", IMAGE.shape)
    images.save("d", IMAGE)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.base", "c.base", "d.base", "other.txt"]


def test_cache_folder_follows_environment_and_platform(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("TISCENE_CACHE", str(tmp_path))
    assert cache_folder() == tmp_path
    monkeypatch.delenv("TISCENE_CACHE")
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "tiscene"


def key_of(scene: MovingBalls, **others: int) -> str:
    scene.device.place(scene.at(*BALLS))
    return BaseImageCache(Path()).key(scene.device, ~scene.moving, scene.view, SETTINGS | others)


def test_key_depends_on_everything_visible() -> None:
    scene = MovingBalls()
    key = key_of(scene)
    assert key_of(MovingBalls()) == key
    scene.placed.world_from_object[:, 0, 0, 3] += 1e-9
    different = {
        "pose": key_of(scene),
        "seed": key_of(MovingBalls(), seed=2),
        "lights": key_of(MovingBalls(lights="point")),
        "camera": key_of(MovingBalls(camera=replace(MovingBalls().view.current, lens_radius=0.01))),
        "object": key_of(MovingBalls(wall=BLUE)),
    }
    scene = MovingBalls()
    scene.view = replace(scene.view, width=33)
    different["size"] = key_of(scene)
    scene = MovingBalls()
    for color in (0.2, 0.7):
        scene.placed = replace(scene.placed, color=np.full((3, len(scene.moving), 4), color, np.float32))
        different[f"color {color}"] = key_of(scene)
    scene = MovingBalls()
    scene.device.add(described([ball((0, 0, 0), 1.0)], [matte("white", WHITE)]))  # a template that is not placed
    assert key_of(scene) == key
    assert len({key, *different.values()}) == 1 + len(different), different


def test_key_depends_on_version_of_taichi(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, keys = MovingBalls(), set()
    for version in ((1, 7, 4), (1, 7, 5)):
        monkeypatch.setattr("taichi.__version__", version)
        _program_digest.cache_clear()
        keys.add(key_of(scene))
    _program_digest.cache_clear()
    assert len(keys) == 2


def test_key_depends_on_textures_and_materials() -> None:
    def keyed(description: SceneDescription) -> str:
        scene = MovingBalls()
        key_of(scene)  # uploads the meshes
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


def test_descriptions_at_the_same_address_have_different_digests() -> None:
    """Python gives the memory of one that is deleted to the next."""
    digests, addresses = set(), set()
    for number in range(100):
        description = SceneDescription("scene", materials=(matte(str(number), WHITE),))
        digests.add(content_digest(description))
        addresses.add(id(description))
    assert len(digests) == 100
    assert len(addresses) < 100


def test_loaded_base_gives_same_bytes_and_is_not_rendered_again(tmp_path: Path) -> None:
    """A file with other pixels changes the image, which shows that it is loaded."""
    images = BaseImageCache(tmp_path)
    scene = MovingBalls()
    plain = stacked(scene.render(*BALLS))
    for _ in range(2):
        scene.incremental = IncrementalPass(PathPass(scene.device, *SIZE), images=images)
        np.testing.assert_array_equal(stacked(scene.render(*BALLS)), plain)
    (path,) = tmp_path.iterdir()
    images.save(path.stem, np.full((SIZE[1], SIZE[0], 9), 7.0, np.float32))
    scene.incremental = IncrementalPass(PathPass(scene.device, *SIZE), images=images)
    assert (scene.render().hdr == 7.0).all()
    assert QUALITY["spp"] == scene.incremental._prepared()[0].cache.spp
