# SPDX-License-Identifier: Apache-2.0
"""Contact sheets and animations."""

import numpy as np
import pytest
from PIL import Image

from tests.export.fake_stream import FakeStream
from tiscene.errors import ArgumentError, ExportError
from tiscene.export.animated_image import write_animation
from tiscene.export.contact_sheet import GAP, contact_sheet
from tiscene.frame.buffers import BUFFERS


def test_sheet_has_room_for_every_buffer():
    frame = FakeStream(width=40, height=30)[0]
    sheet = contact_sheet(frame, tile_width=80)
    tall = contact_sheet(frame, tile_width=80, columns=2)
    assert sheet.dtype == np.uint8
    assert 1.2 < sheet.shape[1] / sheet.shape[0] < 2.2
    assert tall.shape[1] == 2 * 80 + 3 * GAP
    assert tall.shape[0] > 60 * len(BUFFERS) / 2


def test_tiles_are_in_the_requested_order():
    frame = FakeStream(width=40, height=30)[0]
    sheet = contact_sheet(frame, ("depth", "rgb"), columns=2, tile_width=40)
    np.testing.assert_array_equal(sheet[GAP : GAP + 30, 40 + 2 * GAP : 80 + 2 * GAP], frame.buffers["rgb"])
    text = sheet[GAP + 30 :]
    assert text.max() > 150


def test_ids_are_not_blended():
    frame = FakeStream(("instance",), width=10, height=8)[0]
    colors = {tuple(color) for color in contact_sheet(frame, tile_width=97)[GAP : GAP + 70, GAP:107].reshape(-1, 3)}
    assert len(colors) <= 7


def test_sheet_without_buffers_is_an_error():
    with pytest.raises(ArgumentError, match="at least one buffer"):
        contact_sheet(FakeStream()[0], ())


@pytest.mark.parametrize("suffix", [".webp", ".gif", ".png"])
def test_animation_has_all_frames_at_the_requested_rate(tmp_path, suffix):
    images = [np.full((20, 30, 3), 60 * k, np.uint8) for k in range(4)]
    path = tmp_path / f"a{suffix}"
    write_animation(path, images, fps=25)
    again = tmp_path / f"b{suffix}"
    write_animation(again, images, fps=25)
    assert path.read_bytes() == again.read_bytes()
    with Image.open(path) as movie:
        assert movie.n_frames == 4
        assert movie.size == (30, 20)
        movie.seek(2)
        movie.load()
        assert movie.info["duration"] == 40
        assert abs(np.asarray(movie.convert("RGB")).mean() - 120) < 4


def test_animation_raises_for_wrong_suffixes_sizes_and_folders(tmp_path):
    image = np.zeros((4, 4, 3), np.uint8)
    with pytest.raises(ArgumentError, match=r"must be \.webp, \.gif, \.png"):
        write_animation(tmp_path / "a.mp4", [image], 25)
    (tmp_path / "file").write_text("")
    with pytest.raises(ExportError, match=r"cannot write .*a\.webp"):
        write_animation(tmp_path / "file" / "a.webp", [image], 25)
    for images in ([], [image, image[:2]]):
        with pytest.raises(ArgumentError, match="must have the same size"):
            write_animation(tmp_path / "a.webp", images, 25)
