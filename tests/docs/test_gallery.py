# SPDX-License-Identifier: Apache-2.0
"""The gallery: pictures know with how many paths and of which scene they were taken."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from docs.tools import gallery
from docs.tools.gallery import GalleryPicture
from docs.tools.template_sheet import save


def test_a_picture_is_taken_again_only_with_more_paths_or_of_another_scene(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gallery, "IMAGES", tmp_path)
    picture, rgb = GalleryPicture("room_03", "Main", {"lighting": "night"}), np.zeros((6, 8, 3), np.uint8)
    assert picture.paths == 0
    save(picture.file, rgb, f"64 paths a pixel of {gallery.digest('room_03')}")
    assert picture.file.name == "room_03_Main_night.jpg"
    assert picture.paths == 64
    save(picture.file, rgb, "64 paths a pixel of another")
    assert picture.paths == 0
    save(picture.file, rgb)
    assert picture.paths == 0
    assert [path.name for path in tmp_path.iterdir()] == [picture.file.name]


def test_the_digest_of_a_scene_is_of_all_that_it_shows() -> None:
    digests = {gallery.digest(scene) for scene in gallery.ROOTS}
    assert len(digests) == len(gallery.ROOTS)


def test_the_page_says_how_its_pictures_were_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    counts = dict.fromkeys((picture.name for picture in gallery.PICTURES), 64)
    monkeypatch.setattr(GalleryPicture, "paths", property(lambda self: counts[self.name]))
    assert "taken with 64 paths a pixel;" in gallery.page()
    counts["room_01_Main_day"] = 24
    assert "taken with 24 to 64 paths a pixel;" in gallery.page()
    counts["room_01_Main_day"] = 0
    assert "earlier state" in gallery.page()


def test_no_picture_is_blown_out_or_crushed() -> None:
    """Those of the rooms as they are: less than a hundredth of each is white or black."""
    for picture in gallery.PICTURES:
        if picture.paths:
            with Image.open(picture.file) as file:
                rgb = np.asarray(file)
            assert (rgb >= 250).all(axis=-1).mean() < 0.01, picture.name
            assert (rgb <= 5).all(axis=-1).mean() < 0.01, picture.name
