# SPDX-License-Identifier: Apache-2.0
"""Verify: damage and other pictures are found; the scene is found by its digest wherever it is."""

import json
import os
import shutil
from pathlib import Path

import pytest

import tiscene as ts
from tests.export.fake_stream import FakeStream, fake_stream_for, skip_without_extra
from tests.export.folders import contents
from tests.usd.helpers import write
from tiscene.cli import main as cli
from tiscene.cli import terminal
from tiscene.errors import ExportError
from tiscene.export import export
from tiscene.export.manifest_stream import render_arguments
from tiscene.export.packing import PACKING
from tiscene.export.verification import Verification, verify
from tiscene.files import lock_folder
from tiscene.render.render_settings import PRESETS

STAGE = """
def Xform "Room" {
    def Camera "Main" {
        double3 xformOp:translate = (0, 0, 6)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Cube "Box" {
        double size = 1
    }
}
"""
BALL = """
def Sphere "Ball" {
    double radius = 0.3
}
"""
BUFFERS = ("instance", "depth", "forward_flow")


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """A stage of one's own, with a template beside it, and an export of four frames."""
    folder = tmp_path_factory.mktemp("home")
    write(folder, STAGE, name="room.usda")
    write(folder, BALL, name="ball.usda")
    path = [ts.Waypoint((-1.0, 0.0, 1.5)), ts.Waypoint((1.0, 0.0, 1.5))]
    ball = ts.Object("ball", str(folder / "ball.usda"), dynamic=ts.LinearWaypoints(path, total_time=1.0))
    scenario = ts.Scenario(str(folder / "room.usda"), [ball])
    with ts.Stream(scenario, width=24, height=18, buffers=BUFFERS, seed=3) as stream:
        export(stream, folder / "out", format="npz", frames=range(4))
    return folder


def test_undisturbed_export_is_good(exported, capsys):
    found = verify(exported / "out")
    assert (found.frames, found.rendered, found.is_good) == (4, 4, True)
    assert cli.main(["verify", str(exported / "out"), "--sample", "2"]) == 0
    assert capsys.readouterr().out == "files of 4 frames are complete; 2 rendered again, same bytes\n"


def test_export_that_is_written_into_is_not_verified(exported, monkeypatch):
    with lock_folder(exported / "out"):
        with pytest.raises(ExportError, match=r"cannot verify .*out': process \d+ .* writes into it"):
            verify(exported / "out", sample=0)
        monkeypatch.setattr(os, "access", lambda path, mode: mode != os.W_OK)  # nothing writes where nothing may
        assert verify(exported / "out", sample=0).is_good


def test_scene_and_templates_are_found_by_digest_in_another_place(exported, tmp_path, monkeypatch):
    shutil.copytree(exported / "out", tmp_path / "copy")
    gone = json.loads((tmp_path / "copy" / "tiscene.json").read_text().replace(str(exported), "/somebody/else"))
    (tmp_path / "copy" / "tiscene.json").write_text(json.dumps(gone))
    with pytest.raises(ExportError, match=r"no file 'room\.usda' with the SHA-256 .*--search DIR"):
        verify(tmp_path / "copy")
    (tmp_path / "elsewhere" / "deep").mkdir(parents=True)
    (tmp_path / "elsewhere" / "room.usda").write_text("#usda 1.0\n")  # the same name, another content
    shutil.copy(exported / "room.usda", tmp_path / "elsewhere" / "deep")
    shutil.copy(exported / "ball.usda", tmp_path / "elsewhere" / "deep")
    found = verify(tmp_path / "copy", search=[tmp_path / "elsewhere"], sample=1)
    assert (found.rendered, found.different) == (1, {})


def test_saved_layer_travels_with_its_export(tmp_path, monkeypatch, capsys):
    """Another home, another folder of templates, another working directory: nothing of the old paths is left."""
    shelf = tmp_path / "old/shelf/templates/bouncing_ball"
    shelf.mkdir(parents=True)
    write(shelf, BALL, name="template.usda")
    (tmp_path / "old/project").mkdir()
    monkeypatch.setenv("HOME", str(tmp_path / "old"))
    monkeypatch.setenv("TISCENE_PATH", str(tmp_path / "old/shelf"))
    monkeypatch.chdir(tmp_path / "old/project")
    path = [ts.Waypoint((-1.0, 0.5, 0.0)), ts.Waypoint((1.0, 0.5, 0.0))]
    balls = [
        ts.Object("ball", "Bouncing Ball", dynamic=ts.LinearWaypoints(path, total_time=1.0)),
        ts.Object("b", "Cube"),
    ]
    with ts.Stream(ts.Scenario("object_view", balls), width=24, height=18, buffers=BUFFERS) as stream:
        stream.to_usd("motion.usda", frames=4)
    with ts.Stream("motion.usda", width=24, height=18, buffers=BUFFERS) as stream:
        export(stream, "out", format="npz", frames=range(4))

    (tmp_path / "new/far").mkdir(parents=True)
    (tmp_path / "old/shelf").rename(tmp_path / "new/far/things")
    (tmp_path / "old/project").rename(tmp_path / "new/moved")
    (tmp_path / "old").rmdir()
    monkeypatch.chdir(tmp_path / "new")
    monkeypatch.setenv("HOME", str(tmp_path / "new"))
    monkeypatch.delenv("TISCENE_PATH")
    assert cli.main(["verify", "moved/out"]) == 2
    assert "not here, or have another content than at the export: templates/bouncing_ball" in capsys.readouterr().err
    monkeypatch.setenv("TISCENE_PATH", str(tmp_path / "new/far/things"))
    assert cli.main(["verify", "moved/out"]) == 0
    assert capsys.readouterr().out == "files of 4 frames are complete; 4 rendered again, same bytes\n"


def test_changed_scene_is_refused(exported, tmp_path):
    shutil.copytree(exported, tmp_path / "home")
    text = (tmp_path / "home/out/tiscene.json").read_text().replace(str(exported), str(tmp_path / "home"))
    (tmp_path / "home/out/tiscene.json").write_text(text)
    write(tmp_path / "home", STAGE.replace("size = 1", "size = 2"), name="room.usda")
    with pytest.raises(ExportError, match="has another content"):
        verify(tmp_path / "home/out")


def test_damaged_files_and_other_pictures_are_reported(exported, tmp_path, capsys):
    shutil.copytree(exported / "out", tmp_path / "out")
    (tmp_path / "out/000002.npz").write_bytes(b"damaged")
    raw = json.loads((tmp_path / "out/tiscene.json").read_text())
    raw["frames"]["1"]["buffers"]["depth"] = "0" * 64
    (tmp_path / "out/tiscene.json").write_text(json.dumps(raw))
    found = verify(tmp_path / "out")
    assert (found.damaged, found.different, found.is_good) == ((2,), {1: ("depth",)}, False)
    assert cli.main(["verify", str(tmp_path / "out"), "--sample", "0"]) == 2
    assert "files of 1 frame are missing or damaged: 2" in capsys.readouterr().err
    with pytest.raises(ExportError, match="is not an export"):
        verify(tmp_path)


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("parts", [{}, {"spp": 3, "denoise": False}, {"relative_error": 0.1}, {"incremental": False}])
def test_every_quality_is_recovered_from_its_settings(name, parts):
    from tiscene.render.render_settings import preset

    settings = preset(name, **parts).to_json(1 << 20)
    arguments = render_arguments(settings)
    cache_bytes = arguments.pop("cache_bytes", 1 << 20)
    assert preset(arguments.pop("quality"), **arguments).to_json(cache_bytes) == settings


def test_search_looks_in_the_folder_of_the_export(exported, tmp_path):
    shutil.copytree(exported / "out", tmp_path / "out")
    for name in ("room.usda", "ball.usda"):
        shutil.copy(exported / name, tmp_path / "out")
    text = (tmp_path / "out/tiscene.json").read_text().replace(str(exported), str(Path("/somebody/else")))
    (tmp_path / "out/tiscene.json").write_text(text)
    assert verify(tmp_path / "out", sample=1).is_good


def test_progress_counts_the_files_and_the_frames_that_are_rendered(exported, capsys, monkeypatch):
    monkeypatch.setattr(terminal, "LINE_EVERY", 0.0)
    assert cli.main(["verify", str(exported / "out"), "--sample", "2"]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "files of frame 0: 1 of 6"
    assert lines[-1] == "frame 3: 6 of 6"
    assert len(lines) == 6


def test_export_of_which_pictures_alone_differ_is_not_good():
    found = Verification(frames=4, rendered=4, damaged=(), different={1: ("depth",)})
    assert not found.is_good
    assert found.problems() == ["1 of 4 frames rendered otherwise (depth): 1"]


@pytest.mark.parametrize(("format", "name"), [("sailenv", "sup/map.json"), ("parquet", "README.md")])
def test_files_about_all_frames_are_verified(tmp_path, format, name):
    skip_without_extra(format)
    export(fake_stream_for(format), tmp_path, format=format, frames=range(2))
    assert verify(tmp_path, sample=0).is_good
    (tmp_path / name).write_bytes(b"damaged")
    found = verify(tmp_path, sample=0)
    assert (found.is_good, found.problems()) == (False, [f"files about all frames are missing or damaged: {name}"])
    raw = json.loads((tmp_path / "tiscene.json").read_text())
    (tmp_path / "tiscene.json").write_text(json.dumps(raw | {"tiscene": "0.0.1"}))  # which may write them otherwise
    assert verify(tmp_path, sample=0).is_good


def test_verifying_a_killed_export_deletes_nothing_and_continuing_it_does(tmp_path):
    stream = FakeStream(("depth",))
    stream.interrupt_at = 3
    with pytest.raises(KeyboardInterrupt):
        export(stream, tmp_path / "out", format="webdataset", frames=range(5))
    for name in ("pieces/000077.bin", f"{PACKING}/000000/shard-000000.tar"):
        (tmp_path / "out" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "out" / name).write_bytes(b"half")
    before = contents(tmp_path / "out")
    assert verify(tmp_path / "out", sample=0).is_good
    assert contents(tmp_path / "out") == before
    for folder in ("out", "whole"):
        export(FakeStream(("depth",)), tmp_path / folder, format="webdataset", frames=range(5))
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")
