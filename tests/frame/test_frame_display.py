# SPDX-License-Identifier: Apache-2.0
"""Pictures of frames in files, windows and notebooks."""

import builtins
import io
import re
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image, ImageShow

from tests.export.fake_stream import CHAIR, ChairMeasurements, FakeStream
from tiscene.errors import ArgumentError, BufferNotFound, ExportError
from tiscene.frame import visualize
from tiscene.frame.buffers import BUFFERS
from tiscene.frame.frame import Frame
from tiscene.frame.object_table import ObjectTable
from tiscene.sailenv.unity_coordinates import flow_of
from tiscene.sailenv.utilities import draw_flow_map


@pytest.fixture
def frame() -> Frame:
    return FakeStream()[1]


def opened(path) -> np.ndarray:
    return np.asarray(Image.open(path))


@pytest.mark.parametrize("suffix", [".png", ".webp"])
def test_rgb_is_saved_exactly_by_default(frame, tmp_path, suffix):
    frame.save(tmp_path / f"frame{suffix}")
    np.testing.assert_array_equal(opened(tmp_path / f"frame{suffix}"), frame.rgb)


@pytest.mark.parametrize("name", BUFFERS)
def test_every_buffer_is_saved_in_its_colors(frame, tmp_path, name):
    frame.save(tmp_path / "buffer.png", name)
    shown = np.asarray(Image.open(tmp_path / "buffer.png").convert("RGB"))
    np.testing.assert_array_equal(shown, frame.picture(name))
    frame.save(tmp_path / "buffer.jpg", name)
    assert opened(tmp_path / "buffer.jpg").shape == (frame.camera.height, frame.camera.width, 3)


def test_ids_are_an_indexed_image_whose_pixels_are_the_ids(frame, tmp_path):
    frame.save(tmp_path / "instance.png", "instance")
    image = Image.open(tmp_path / "instance.png")
    assert image.mode == "P"
    np.testing.assert_array_equal(np.asarray(image), frame.instance)


def test_ids_beyond_a_byte_are_colors(frame, tmp_path):
    frame.instance[2, 3] = 256
    frame.save(tmp_path / "instance.png", "instance")
    image = Image.open(tmp_path / "instance.png")
    assert image.mode == "RGB"
    np.testing.assert_array_equal(np.asarray(image)[2, 3], visualize.id_colors([256])[0])


def test_flow_in_the_colors_of_sailenv_is_what_its_client_draws(frame):
    drawn = draw_flow_map(flow_of(frame.backward_flow))[..., ::-1]
    np.testing.assert_array_equal(frame.picture("backward_flow", flow_colors="sailenv"), drawn)
    drawn = draw_flow_map(flow_of(-frame.forward_flow))[..., ::-1]  # the same motion, as seen from the frame after
    np.testing.assert_array_equal(frame.picture("forward_flow", flow_colors="sailenv"), drawn)
    assert (frame.picture("forward_flow") != frame.picture("forward_flow", flow_colors="sailenv")).any()


def test_invalid_arguments_write_nothing(frame, tmp_path):
    with pytest.raises(ArgumentError, match=r"\.tiff.*\.png"):
        frame.save(tmp_path / "frame.tiff")
    with pytest.raises(ArgumentError, match="flow_colors='rainbow'"):
        frame.save(tmp_path / "flow.png", "forward_flow", flow_colors="rainbow")
    with pytest.raises(BufferNotFound, match="forward_flow"):
        frame.save(tmp_path / "flow.png", "forward_flw")
    assert not list(tmp_path.iterdir())
    (tmp_path / "file").touch()
    with pytest.raises(ExportError, match="cannot write"):
        frame.save(tmp_path / "file" / "frame.png")


def test_notebook_shows_every_buffer_and_the_visible_objects(frame):
    html = frame._repr_html_()
    assert re.findall(r'alt="(\w+)"', html) == list(frame)
    assert "Visible: 1 of 1 object" in html
    assert "<td>chair</td>" in html
    np.testing.assert_array_equal(opened(io.BytesIO(frame._repr_png_())), frame.rgb)


def test_names_of_objects_are_escaped_in_html():
    frame = FakeStream()[0]
    objects = ObjectTable([replace(CHAIR, name="<script>")], ChairMeasurements())
    frame = Frame(0, 0.0, frame.camera, {"depth": frame.depth}, objects)
    assert "<script>" not in frame._repr_html_()
    assert "&lt;script&gt;" in frame._repr_html_()


def test_show_opens_the_viewer_of_the_desktop(frame, monkeypatch):
    shown = []
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(ImageShow, "show", lambda image, title: shown.append((np.asarray(image), title)) or True)
    frame.show("depth")
    ((image, title),) = shown
    np.testing.assert_array_equal(image, frame.picture("depth"))
    assert title == "frame 1"


@pytest.mark.parametrize("display", ["", ":0"])
def test_show_without_a_display_or_viewer_says_what_to_do(frame, monkeypatch, display):
    """It was silent."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.setenv(name, display)
    monkeypatch.setattr(sys, "platform", "linux")
    opened = []
    monkeypatch.setattr(ImageShow, "show", lambda image, title: bool(opened.append(title)))
    with pytest.warns(UserWarning, match=r"frame 1 is not shown: there is no display.*frame\.save") as caught:
        frame.show()
    assert caught[0].filename == __file__
    assert bool(opened) == bool(display)


def test_show_displays_in_a_notebook(frame, monkeypatch):
    display = pytest.importorskip("IPython.display")
    shown = []
    monkeypatch.setattr(builtins, "get_ipython", lambda: SimpleNamespace(kernel=1), raising=False)
    monkeypatch.setattr(display, "display", shown.append)
    frame.show()
    np.testing.assert_array_equal(np.asarray(shown[0]), frame.rgb)
