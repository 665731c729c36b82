# SPDX-License-Identifier: Apache-2.0
"""A folder of frames and its manifest: complete, repeatable, resumable, never silently mixed."""

import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest

from tests.export.fake_stream import FakeStream
from tiscene.errors import ArgumentError, ExportError
from tiscene.export import EXPORTERS, SUMMARIES, export
from tiscene.export.manifest import NAME, Manifest, buffer_digest, frame_digest
from tiscene.frame.frame import FrameCamera
from tiscene.scene.camera import Camera


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.parametrize("format", EXPORTERS)
def test_the_same_frames_are_the_same_bytes_and_nothing_else_is_left(tmp_path, format):
    for folder in ("a", "b"):
        export(FakeStream(), tmp_path / folder, format=format, frames=range(3))
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    manifest = Manifest.load(tmp_path / "a")
    listed = {name for entry in manifest.frames.values() for name in entry["files"]}
    summary, _ = SUMMARIES.get(format, ((), None))
    assert set(contents(tmp_path / "a")) == listed | {NAME, *summary}


def test_the_manifest_says_how_it_was_made_and_what_is_there(tmp_path):
    stream = FakeStream(("rgb", "depth"), seed=7)
    export(stream, tmp_path, frames=[4, 2])
    raw = json.loads((tmp_path / NAME).read_text())
    assert list(raw) == [
        "tiscene",
        "format",
        "buffers",
        "objects",
        "settings",
        "scenario",
        "layers",
        "categories",
        "materials",
        "frames",
    ]
    assert raw["settings"]["seed"] == 7
    assert raw["categories"] == {"0": "", "1": "chair", "2": "table"}
    assert raw["materials"] == {}  # nobody asked for their coverage
    assert list(raw["frames"]) == ["2", "4"]
    entry = raw["frames"]["4"]
    frame = stream[4]
    assert entry["digest"] == frame_digest(frame)
    assert entry["buffers"] == {name: buffer_digest(buffer) for name, buffer in frame.buffers.items()}
    png = (tmp_path / "rgb" / "000004.png").read_bytes()
    assert entry["files"]["rgb/000004.png"] == hashlib.sha256(png).hexdigest()


def test_the_manifest_names_the_materials_that_a_buffer_shows(tmp_path):
    export(FakeStream(("material_coverage",)), tmp_path, frames=[0])
    assert Manifest.load(tmp_path).materials == {0: "", 1: "/Looks/Oak"}
    raw = json.loads((tmp_path / NAME).read_text())
    del raw["materials"]
    (tmp_path / NAME).write_text(json.dumps(raw))
    assert Manifest.load(tmp_path).materials == {}  # one written before there were any


def test_an_interrupted_run_goes_on_and_ends_in_the_same_folder(tmp_path):
    export(FakeStream(), tmp_path / "whole", frames=range(6))
    stream = FakeStream()
    stream.interrupt_at = 4
    with pytest.raises(KeyboardInterrupt):
        export(stream, tmp_path / "parts", frames=range(6))
    assert sorted(Manifest.load(tmp_path / "parts").frames) == [0, 1, 2, 3]
    again, seen = FakeStream(), []
    export(
        again, tmp_path / "parts", frames=range(6), progress=lambda index, frame: seen.append((index, frame is None))
    )
    assert again.rendered == [4, 5]
    assert seen == [(0, True), (1, True), (2, True), (3, True), (4, False), (5, False)]
    assert contents(tmp_path / "parts") == contents(tmp_path / "whole")


def test_lost_or_changed_files_are_made_again(tmp_path):
    export(FakeStream(), tmp_path, frames=range(4))
    before = contents(tmp_path)
    (tmp_path / "rgb" / "000001.png").unlink()
    (tmp_path / "depth" / "000002.png").write_bytes(b"half a file")
    again = FakeStream()
    export(again, tmp_path, frames=range(4))
    assert again.rendered == [1, 2]
    assert contents(tmp_path) == before


def test_other_settings_are_refused_and_told(tmp_path):
    export(FakeStream(seed=1), tmp_path, frames=range(3))
    before = contents(tmp_path)
    with pytest.raises(ExportError, match=r"settings\.seed: 1 there, 2 now(.|\n)*--overwrite") as caught:
        export(FakeStream(seed=2), tmp_path, frames=range(3))
    assert "settings.width" not in str(caught.value)
    with pytest.raises(ExportError, match='format: "png" there, "npz" now'):
        export(FakeStream(seed=1), tmp_path, format="npz", frames=range(3))
    assert contents(tmp_path) == before


def test_overwrite_removes_what_the_manifest_lists_and_nothing_else(tmp_path):
    export(FakeStream(seed=1), tmp_path, frames=range(3))
    mine = tmp_path / "notes.txt"
    mine.write_text("keep")
    raw = json.loads((tmp_path / NAME).read_text())
    outside = tmp_path.parent / "outside.txt"
    outside.write_text("keep")
    raw["frames"]["0"]["files"]["../outside.txt"] = "0"
    (tmp_path / NAME).write_text(json.dumps(raw))
    export(FakeStream(seed=2), tmp_path, format="npz", frames=range(1), overwrite=True)
    assert set(contents(tmp_path)) == {"000000.npz", "labels/000000.json", "notes.txt", NAME}
    assert outside.exists()


def test_bad_calls(tmp_path):
    with pytest.raises(ArgumentError, match="format='jpg': must be one of cryptomatte, exr, npz, png, sailenv"):
        export(FakeStream(), tmp_path, format="jpg", frames=range(1))
    with pytest.raises(ArgumentError, match=r"frames=range"):
        export(FakeStream(), tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(ExportError, match="it is a file, not a folder"):
        export(FakeStream(), tmp_path / "file", frames=range(1))
    with pytest.raises(ExportError, match="cannot write into"):
        export(FakeStream(), tmp_path / "file" / "below", frames=range(1))


@pytest.mark.parametrize("text", ["{", "[]", '{"frames": {}}', '{"frames": {"0": {}}, "categories": {}}'])
def test_a_foreign_manifest_is_left_alone(tmp_path, text):
    (tmp_path / NAME).write_text(text)
    with pytest.raises(ExportError, match="is not a manifest of tiscene"):
        export(FakeStream(), tmp_path, frames=range(1), overwrite=True)
    assert contents(tmp_path) == {NAME: text.encode()}


def test_digests_see_type_shape_and_every_byte():
    array = np.arange(6, dtype=np.float32).reshape(2, 3)
    variants = [array, array.T, array.reshape(3, 2), array.astype(np.float64), array + np.float32(1e-7)]
    assert len({buffer_digest(variant) for variant in variants}) == 5
    assert buffer_digest(array) == buffer_digest(np.asfortranarray(array)) == buffer_digest(array.astype(">f4"))


class Several(FakeStream):
    """A stream that three cameras watch."""

    names = ("Main", "Over the door", "a/b:..")

    def __getitem__(self, index):
        first, *others = [
            replace(super(Several, self).__getitem__(100 * row + index), index=index) for row in range(len(self.names))
        ]
        first, *others = [
            replace(each, camera=FrameCamera(Camera(name=name), self.width, self.height))
            for each, name in zip((first, *others), self.names, strict=True)
        ]
        return replace(first, others=tuple(others))


@pytest.mark.parametrize("format", EXPORTERS)
def test_several_cameras_have_a_folder_each(tmp_path, format):
    manifest = export(Several(), tmp_path / "all", format=format, frames=range(3))
    folders = ("Main", "Over the door", "a_b_._")
    assert manifest.folders == [f"{each}/" for each in folders]
    found = contents(tmp_path / "all")
    listed = {name for entry in manifest.frames.values() for name in entry["files"]}
    summary = {f"{each}/{name}" for each in folders for name in SUMMARIES.get(format, ((), None))[0]}
    assert set(found) == listed | summary | {NAME}
    alone = contents(tmp_path / "one") if export(FakeStream(), tmp_path / "one", format=format, frames=range(3)) else {}
    for name, data in alone.items():
        if name != NAME and "labels" not in name:
            assert found[f"Main/{name}"] == data
    different = [name.removeprefix("Main/") for name in found if name.startswith("Main/") and "labels" not in name]
    assert any(found[f"Main/{name}"] != found[f"a_b_._/{name}"] for name in different)
    assert manifest.frames[0]["digest"] == frame_digest(Several()[0])


def test_a_run_of_several_cameras_goes_on_and_can_be_replaced(tmp_path):
    export(Several(), tmp_path, frames=range(3))
    before = contents(tmp_path)
    (tmp_path / "a_b_._" / "rgb" / "000001.png").unlink()
    again, seen = Several(), []
    export(again, tmp_path, frames=range(3), progress=lambda index, frame: seen.append(frame is None))
    assert seen == [True, False, True]
    assert contents(tmp_path) == before
    export(FakeStream(seed=1), tmp_path, frames=range(1), overwrite=True)
    assert not [name for name in contents(tmp_path) if name.startswith(("Main", "Over", "a_b"))]


def test_cameras_that_would_share_a_folder_are_refused(tmp_path):
    stream = Several()
    stream.names = ("a/b", "A:B")
    with pytest.raises(ExportError, match="'a/b', 'A:B' two would write into the folder 'A_B/'"):
        export(stream, tmp_path, frames=range(1))
