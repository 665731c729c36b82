# SPDX-License-Identifier: Apache-2.0
"""`tiscene preview` and `tiscene view`."""

import sys

import numpy as np
import pytest

from tiscene.cli import main as cli
from tiscene.stream.stream import Stream

ARGUMENTS = ("--frames", "0:3", "--width", "16", "--height", "12", "--buffers", "instance,depth")


def test_preview_writes_a_page_and_prints_its_path(tmp_path, capsys):
    page = tmp_path / "page.html"
    assert cli.main(["preview", "solid_benchmark", "-o", str(page), *ARGUMENTS]) == 0
    assert capsys.readouterr().out == f"{page}\n"
    assert page.read_text().startswith("<!doctype html>")


@pytest.mark.parametrize("name", ["page.txt", "page", "page.json"])
def test_page_of_another_kind_is_refused_before_rendering(tmp_path, capsys, name):
    assert cli.main(["preview", "solid_benchmark", "-o", str(tmp_path / name), *ARGUMENTS]) == 2
    assert f"{name}': a page is a file that ends in .html or .htm" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_unknown_buffer_is_explained(tmp_path, capsys):
    page = tmp_path / "page.html"
    assert cli.main(["preview", "solid_benchmark", "-o", str(page), "--buffers", "dept"]) == 2
    assert "Did you mean 'depth'?" in capsys.readouterr().err
    assert not page.exists()


def test_view_records_every_buffer_of_every_frame(tmp_path, capsys):
    pytest.importorskip("rerun")
    from rerun.chunk import RrdReader

    file = tmp_path / "run.rrd"
    assert cli.main(["view", "solid_benchmark", "--save", str(file), *ARGUMENTS]) == 0
    assert capsys.readouterr().out == f"{file}\n"
    depth = {}
    for chunk in RrdReader(file).stream():
        batch = chunk.to_record_batch()
        if "world/camera/depth" in str(batch.schema.metadata):
            names = batch.schema.names
            frames = batch.column(names.index("frame")).to_pylist()
            data = batch.column(next(i for i, name in enumerate(names) if name.endswith("buffer"))).to_pylist()
            depth |= dict(zip(frames, (np.array(each[0], np.uint8).view(np.float32) for each in data), strict=True))
    stream = Stream("solid_benchmark", width=16, height=12, buffers=("depth",))
    assert sorted(depth) == [0, 1, 2]
    for index, values in depth.items():
        np.testing.assert_array_equal(values.reshape(12, 16), stream[index].depth)


def test_view_of_several_cameras_is_refused(capsys):
    pytest.importorskip("rerun")
    assert cli.main(["view", "room_01", "--save", "run.rrd", "--camera", "Main,Chest", *ARGUMENTS]) == 2
    assert "one camera" in capsys.readouterr().err


def test_view_without_a_display_says_what_to_do(monkeypatch, capsys):
    """It ended with a traceback, after rendering."""
    pytest.importorskip("rerun")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    assert cli.main(["view", "solid_benchmark", *ARGUMENTS]) == 2
    assert "there is no display for the viewer: `--save run.rrd` writes a file" in capsys.readouterr().err


def test_view_without_rerun_names_the_extra(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert cli.main(["view", "solid_benchmark", *ARGUMENTS]) == 2
    assert "pip install 'tiscene[rerun]'" in capsys.readouterr().err
