# SPDX-License-Identifier: Apache-2.0
"""Authoring is repeatable: the same bytes in each run, and the content of the committed files on any processor."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pxr import Gf, Sdf

import usd_scenes
from usd_scenes.author.__main__ import SCENES, jobs
from usd_scenes.author.templates import TEMPLATES

PACKAGE = Path(usd_scenes.__file__).parent
FAST = ["pages", "screen", "cube", "chair_01", "dish_01", "laptop_01", "object_view"]
TEXTURE = re.compile(r"@[^@]*textures/([^@]+)@")
SLOW = [name for name in jobs(PACKAGE) if name not in FAST]
# A scene and its cloth whose simulated folds amplify rounding: most of it ends alike on any processor, not each vertex.
FOLDED = "room_01", "/Geometry/Throw/"


def author(name: str, folder: Path) -> dict[str, bytes]:
    jobs(folder)[name]()
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def assert_same_content(made: Path, committed: Path) -> None:
    """Assert equality up to rounding differences between processors: one gray level, 0.2 mm."""
    if made.read_bytes() == committed.read_bytes():
        return
    if made.suffix == ".png":
        a, b = (np.asarray(Image.open(path), dtype=np.int32) for path in (made, committed))
        assert a.shape == b.shape
        difference = np.abs(a - b)
        assert (difference > 1).mean() < 1e-3
    elif made.suffix == ".hdr":
        a, b = (np.frombuffer(path.read_bytes(), dtype=np.uint8) for path in (made, committed))
        assert abs(len(a) - len(b)) < 0.01 * len(b)
    else:
        layers = [Sdf.Layer.FindOrOpen(str(path)) for path in (made, committed)]
        paths: list[set[str]] = []
        for layer in layers:
            found: set[str] = set()
            layer.Traverse("/", lambda path, found=found: found.add(str(path)))
            paths.append(found)
        assert paths[0] == paths[1]
        for path in sorted(paths[0]):
            first, second = (layer.GetAttributeAtPath(path) for layer in layers)
            if first is not None and first.default is not None:
                folded = committed.parent.name == FOLDED[0] and path.startswith(FOLDED[1])
                _assert_close(first.default, second.default, path, folded)
            links = [layer.GetRelationshipAtPath(path) for layer in layers]
            if links[0] is not None:
                targets = [link.targetPathList.GetAppliedItems() for link in links]
                assert targets[0] == targets[1], path


def _assert_close(first: object, second: object, path: str, folded: bool) -> None:
    if isinstance(first, Gf.Quatf) and isinstance(second, Gf.Quatf):
        first, second = ((each.real, *each.imaginary) for each in (first, second))
    try:
        a, b = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    except (TypeError, ValueError):
        assert first == second, path
        return
    if folded:
        assert a.shape == b.shape, path
        assert np.quantile(np.abs(a - b), 0.9) < 0.02, path
    else:
        np.testing.assert_allclose(a, b, atol=2e-4, err_msg=path)


@pytest.mark.parametrize("name", FAST)
def test_authoring_twice_writes_same_bytes_and_committed_content(name: str, tmp_path: Path) -> None:
    once, twice = author(name, tmp_path / "once"), author(name, tmp_path / "twice")
    assert once == twice
    assert once
    for file in once:
        assert_same_content(tmp_path / "once" / file, PACKAGE / file)


@pytest.mark.slow
@pytest.mark.parametrize("name", SLOW)
def test_authoring_slow_items_writes_committed_content(name: str, tmp_path: Path) -> None:
    for file in author(name, tmp_path):
        assert_same_content(tmp_path / file, PACKAGE / file)


def test_every_committed_file_is_authored_and_every_texture_used() -> None:
    stages = [*PACKAGE.glob("templates/*/*.usd?"), *PACKAGE.glob("*/*.usd?")]
    assert {path.parent.name for path in stages} == {*TEMPLATES, *SCENES}
    named = {name for path in stages if path.suffix == ".usda" for name in TEXTURE.findall(path.read_text("utf-8"))}
    assert named == {path.name for path in (PACKAGE / "textures").iterdir()}
