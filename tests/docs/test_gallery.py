# SPDX-License-Identifier: Apache-2.0
"""The gallery: pictures record their samples per pixel and their scene, and the page reports both."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from docs.tools import gallery
from docs.tools.gallery import GalleryPicture
from docs.tools.template_sheet import save


def test_recorded_spp_counts_only_for_the_current_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gallery, "IMAGES", tmp_path)
    picture, rgb = GalleryPicture("room_03", "Main", {"lighting": "night"}), np.zeros((6, 8, 3), np.uint8)
    assert picture.spp == 0
    save(picture.file, rgb, f"64{gallery.COMMENT}{gallery.digest('room_03')}")
    width = rgb.shape[1]
    assert picture.is_made(64, width)
    assert not picture.is_made(65, width)
    assert not picture.is_made(64, width + 1)
    assert picture.file.name == "room_03_Main_night.jpg"
    assert picture.spp == 64
    save(picture.file, rgb, f"64{gallery.COMMENT}another")
    assert picture.spp == 0
    save(picture.file, rgb)
    assert picture.spp == 0
    assert [path.name for path in tmp_path.iterdir()] == [picture.file.name]


def test_scene_digests_differ() -> None:
    digests = {gallery.digest(scene) for scene in gallery.ROOTS}
    assert len(digests) == len(gallery.ROOTS)


def test_page_reports_samples_per_pixel(monkeypatch: pytest.MonkeyPatch) -> None:
    counts = dict.fromkeys((picture.name for picture in gallery.PICTURES), 64)
    monkeypatch.setattr(GalleryPicture, "spp", property(lambda self: counts[self.name]))
    assert "have 64 samples per pixel. " in gallery.page()
    counts["room_01_Main_day"] = 24
    assert "have 24 to 64 samples per pixel. " in gallery.page()
    counts["room_01_Main_day"] = 0
    assert "earlier state" in gallery.page()


def test_pictures_are_neither_overexposed_nor_underexposed() -> None:
    """Less than a hundredth of each picture of a current scene is white or black."""
    for picture in gallery.PICTURES:
        if picture.spp:
            with Image.open(picture.file) as file:
                rgb = np.asarray(file)
            assert (rgb >= 250).all(axis=-1).mean() < 0.01, picture.name
            assert (rgb <= 5).all(axis=-1).mean() < 0.01, picture.name
