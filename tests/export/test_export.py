# SPDX-License-Identifier: Apache-2.0
"""Exports: complete, repeatable, continued after an interruption, never mixed with other settings."""

import hashlib
import json
import os
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import tiscene
from tests.export.fake_stream import FAKE_FORMATS, FakeStream, fake_stream_for, skip_without_extra
from tests.export.folders import contents
from tiscene.errors import ArgumentError, ExportError
from tiscene.export import FORMATS, export, verify
from tiscene.export.manifest import NAME, Manifest, buffer_digest, frame_entry
from tiscene.export.manifest_difference import cure, differences
from tiscene.frame.buffers import BUFFERS
from tiscene.frame.frame import FrameCamera
from tiscene.scene.camera import Camera


def summary_of(format):
    return getattr(FORMATS[format].writer(), "SUMMARY", ())


@pytest.mark.parametrize("format", FAKE_FORMATS)
def test_export_of_any_format_is_continued_extended_and_repaired_to_the_same_files_which_it_lists(tmp_path, format):
    skip_without_extra(format)
    export(fake_stream_for(format), tmp_path / "whole", format=format, frames=range(6))
    whole, manifest = contents(tmp_path / "whole"), Manifest.load(tmp_path / "whole")
    listed = {name for entry in manifest.frames.values() for name in entry["files"]}
    assert set(whole) == listed | {NAME, *summary_of(format)}
    stream = fake_stream_for(format)
    stream.interrupt_at = 4
    with pytest.raises(KeyboardInterrupt):
        export(stream, tmp_path / "parts", format=format, frames=range(6))
    assert list(Manifest.load(tmp_path / "parts").frames) == [0, 1, 2, 3]
    again, seen = fake_stream_for(format), []
    known = {"format": format, "frames": range(6), "progress": lambda index, frame: seen.append((index, frame is None))}
    export(again, tmp_path / "parts", **known)
    assert again.rendered == [4, 5]
    assert seen == [(0, True), (1, True), (2, True), (3, True), (4, False), (5, False)]
    assert contents(tmp_path / "parts") == whole
    export(fake_stream_for(format), tmp_path / "longer", format=format, frames=range(3))
    export(fake_stream_for(format), tmp_path / "longer", format=format, frames=range(3, 6))
    assert contents(tmp_path / "longer") == whole
    name = max(manifest.frames[5]["files"], key=lambda name: "labels" not in name)
    (tmp_path / "longer" / name).write_bytes(b"damaged")
    export(fake_stream_for(format), tmp_path / "longer", format=format, frames=range(6))
    assert contents(tmp_path / "longer") == whole


def test_manifest_has_provenance_and_digests(tmp_path):
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
        "file_digests",
        "categories",
        "materials",
        "frames",
    ]
    assert raw["settings"]["seed"] == 7
    assert raw["categories"] == {"0": "", "1": "chair", "2": "table"}
    assert raw["materials"] == {}  # the stream has no material_coverage
    assert list(raw["frames"]) == ["2", "4"]
    entry = raw["frames"]["4"]
    frame = stream[4]
    assert entry["digest"] == frame_entry(frame, {})["digest"]
    assert entry["buffers"] == {name: buffer_digest(buffer) for name, buffer in frame.buffers.items()}
    png = (tmp_path / "rgb" / "000004.png").read_bytes()
    assert entry["files"]["rgb/000004.png"] == hashlib.sha256(png).hexdigest()


def test_manifest_names_the_materials_of_material_coverage(tmp_path):
    export(FakeStream(("material_coverage",)), tmp_path, frames=[0])
    assert Manifest.load(tmp_path).materials == {0: "", 1: "/Looks/Oak"}
    raw = json.loads((tmp_path / NAME).read_text())
    del raw["materials"]
    (tmp_path / NAME).write_text(json.dumps(raw))
    assert Manifest.load(tmp_path).materials == {}  # as of an earlier version


def test_missing_or_changed_files_are_written_again(tmp_path):
    export(FakeStream(), tmp_path, frames=range(4))
    before = contents(tmp_path)
    (tmp_path / "rgb" / "000001.png").unlink()
    (tmp_path / "depth" / "000002.png").write_bytes(b"half a file")
    again = FakeStream()
    export(again, tmp_path, frames=range(4))
    assert again.rendered == [1, 2]
    assert contents(tmp_path) == before


def test_export_with_other_settings_is_refused_and_names_them(tmp_path):
    export(FakeStream(seed=1), tmp_path, frames=range(3))
    before = contents(tmp_path)
    with pytest.raises(ExportError, match=r"settings\.seed: 1 in the folder, 2 requested(.|\n)*--overwrite") as caught:
        export(FakeStream(seed=2), tmp_path, frames=range(3))
    assert "settings.width" not in str(caught.value)
    with pytest.raises(ExportError, match='format: "png" in the folder, "npz" requested'):
        export(FakeStream(seed=1), tmp_path, format="npz", frames=range(3))
    assert contents(tmp_path) == before


@pytest.mark.parametrize(
    ("first", "then", "sentence"),
    [
        ({"seed": 1}, {"seed": 2}, r"To continue that export, pass seed=1 (--seed 1). To replace them, pass"),
        ({"width": 8, "height": 4}, {}, "pass height=4, width=8 (--height 4 --width 8)"),
        ({"format": "npz", "seed": 1}, {}, "pass format='npz', seed=1 (--format npz --seed 1)"),
        ({"objects": "visible"}, {}, "pass objects='visible' (--objects visible)"),
        ({}, {"objects": "all"}, "pass objects=None (without --objects)"),
        ({"buffers": ("rgb", "depth")}, {}, "pass buffers=['rgb', 'depth'] (--buffers rgb,depth)"),
    ],
)
def test_refused_export_names_the_arguments_that_continue_the_earlier_one(tmp_path, first, then, sentence):
    def run(**arguments):
        to_export = {name: arguments.pop(name) for name in ("format", "objects") if name in arguments}
        export(FakeStream(arguments.pop("buffers", tuple(BUFFERS)), **arguments), tmp_path, frames=[0], **to_export)

    run(**first)
    with pytest.raises(ExportError) as caught:
        run(**then)
    assert sentence in str(caught.value)
    run(**first)


@pytest.mark.parametrize(
    ("key", "there", "now", "sentence"),
    [
        ("tiscene", "0.0.1", tiscene.__version__, "use tiscene 0.0.1."),
        ("file_digests", {"a": "1"}, {"a": "2"}, "restore the files of the scene that have changed since."),
        ("scenario", {"objects": []}, {"objects": [1]}, "export, use the scenario of that export, which is another."),
        (
            "scenario",
            {"objects": [], "camera": None, "variants": {}},
            {"objects": [1], "camera": "Sofa", "variants": {"/R{l}": "a"}},
            "export, use the scenario of that export, which is another.",
        ),
        ("scenario", {"camera": "Sofa"}, {"camera": None}, "pass camera='Sofa' (--camera Sofa)."),
        ("scenario", {"camera": {"name": "x"}}, {"camera": None}, "export, use the scenario of that export, which is"),
        (
            "scenario",
            {"camera": None},
            {"camera": [{"name": "x"}]},
            "export, use the scenario of that export, which is",
        ),
        ("settings", {"spp": 1, "denoiser": "fast"}, {"spp": 4, "denoiser": "high"}, "pass the quality of that export"),
        ("settings", {"spp": 1, "denoiser": None}, {"spp": 4, "denoiser": "high"}, "pass denoise=False, spp=1 ("),
        ("settings", {"incremental": [64, 0]}, {"incremental": None}, "pass incremental=True (--incremental)."),
        ("settings", {"files": "1"}, {"files": "2"}, "export, restore the files of the scene that have changed since."),
        ("settings", {"categories": ["cup"]}, {"categories": None}, "pass categories=['cup'] (--categories cup)."),
        ("settings", {"subdivision": None}, {"subdivision": 0}, "(without --subdivision)."),
        ("settings", {"lights": "1"}, {}, "export, replace its lights as for that export (set_light)."),
        ("settings", {"variants": {"/R{l}": "a"}}, {"variants": {}}, "(--variant '/R{l}=a')."),
        ("name", "000003", None, "To continue that export, let `tiscene generate` continue its data set."),
        ("settings", {"clamp": None, "fps": 5.0}, {"clamp": 2.0, "fps": 1.0}, "(--fps 5.0, without --clamp)."),
    ],
)
def test_cure_names_arguments_files_and_versions(key, there, now, sentence):
    found = differences({key: there}, {key: now})
    assert sentence in cure(found, {key: there})


@pytest.mark.parametrize("format", ["png", "webdataset"])
def test_frame_that_is_asked_for_twice_is_written_once(tmp_path, format):
    seen = []
    frames = [3, 0, 0, 1, 3]
    export(FakeStream(), tmp_path, format=format, frames=frames, progress=lambda index, _: seen.append(index))
    assert seen == [3, 0, 1]
    assert list(Manifest.load(tmp_path).frames) == [0, 1, 3]


def test_second_export_into_a_folder_is_refused_while_the_first_one_runs(tmp_path):
    def export_again(index, frame):
        with pytest.raises(ExportError, match=rf"process {os.getpid()} on .* writes into it\. Wait until it is done"):
            export(FakeStream(), tmp_path, frames=[7])

    export(FakeStream(), tmp_path, frames=range(2), progress=export_again)
    export(FakeStream(), tmp_path, frames=[7])
    assert sorted(Manifest.load(tmp_path).frames) == [0, 1, 7]


def test_overwrite_deletes_only_files_of_the_manifest(tmp_path):
    export(FakeStream(seed=1), tmp_path, frames=range(3))
    notes = tmp_path / "notes.txt"
    notes.write_text("keep")
    raw = json.loads((tmp_path / NAME).read_text())
    outside = tmp_path.parent / "outside.txt"
    outside.write_text("keep")
    raw["frames"]["0"]["files"]["../outside.txt"] = "0"
    (tmp_path / NAME).write_text(json.dumps(raw))
    export(FakeStream(seed=2), tmp_path, format="npz", frames=range(1), overwrite=True)
    assert set(contents(tmp_path)) == {"000000.npz", "labels/000000.json", "notes.txt", NAME}
    assert outside.exists()


def test_invalid_arguments_and_folders_raise(tmp_path):
    with pytest.raises(ArgumentError, match="format='jpg': must be one of png, exr, exr-single, npz"):
        export(FakeStream(), tmp_path, format="jpg", frames=range(1))
    with pytest.raises(ArgumentError, match=r"the stream is endless; pass the frames"):
        export(FakeStream(), tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(ExportError, match="it is a file, not a folder"):
        export(FakeStream(), tmp_path / "file", frames=range(1))
    with pytest.raises(ExportError, match=r"cannot write .*below"):
        export(FakeStream(), tmp_path / "file" / "below", frames=range(1))


@pytest.mark.parametrize("text", ["{", "[]", '{"frames": {}}', '{"frames": {"0": {}}, "categories": {}}'])
def test_file_that_is_no_manifest_is_not_overwritten(tmp_path, text):
    (tmp_path / NAME).write_text(text)
    with pytest.raises(ExportError, match=r"tiscene\.json is damaged, or is not a manifest of tiscene: choose another"):
        export(FakeStream(), tmp_path, frames=range(1), overwrite=True)
    assert contents(tmp_path) == {NAME: text.encode()}


@pytest.mark.parametrize("lost", ["format", "settings", "file_digests", "buffers of a frame"])
def test_manifest_that_lacks_a_part_is_named(tmp_path, lost):
    export(FakeStream(), tmp_path, format="npz", frames=range(1))
    content = json.loads((tmp_path / NAME).read_text())
    del (content["frames"]["0"] if lost == "buffers of a frame" else content)[lost.split()[0]]
    (tmp_path / NAME).write_text(json.dumps(content))
    with pytest.raises(ExportError, match=r"tiscene\.json is damaged"):
        verify(tmp_path, sample=0)


def test_buffer_digest_depends_on_type_shape_and_values_alone():
    array = np.arange(6, dtype=np.float32).reshape(2, 3)
    variants = [array, array.T, array.reshape(3, 2), array.astype(np.float64), array + np.float32(1e-7)]
    assert len({buffer_digest(variant) for variant in variants}) == 5
    assert buffer_digest(array) == buffer_digest(np.asfortranarray(array)) == buffer_digest(array.astype(">f4"))


class ThreeCameraStream(FakeStream):
    """A fake stream with three cameras."""

    names = ("Main", "Over the door", "a/b:..")

    def __getitem__(self, index):
        first, *others = [
            replace(super(ThreeCameraStream, self).__getitem__(100 * row + index), index=index)
            for row in range(len(self.names))
        ]
        first, *others = [
            replace(each, camera=FrameCamera(Camera(name=name), self.width, self.height))
            for each, name in zip((first, *others), self.names, strict=True)
        ]
        return replace(first, _other_views=tuple(others))


@pytest.mark.parametrize("format", FAKE_FORMATS)
def test_several_cameras_have_one_folder_each(tmp_path, format):
    skip_without_extra(format)
    buffers = fake_stream_for(format).buffers
    manifest = export(ThreeCameraStream(buffers), tmp_path / "all", format=format, frames=range(3))
    folders = ("Main", "Over the door", "a_b_._")
    assert manifest.folders == [f"{each}/" for each in folders]
    found = contents(tmp_path / "all")
    listed = {name for entry in manifest.frames.values() for name in entry["files"]}
    summary = {f"{each}/{name}" for each in folders for name in summary_of(format)}
    assert set(found) == listed | summary | {NAME}
    export(FakeStream(buffers), tmp_path / "one", format=format, frames=range(3))
    alone = contents(tmp_path / "one")
    for name, data in alone.items():
        if name != NAME and "labels" not in name and not getattr(FORMATS[format].writer(), "HOLDS_LABELS", False):
            assert found[f"Main/{name}"] == data
    different = [name.removeprefix("Main/") for name in found if name.startswith("Main/") and "labels" not in name]
    assert any(found[f"Main/{name}"] != found[f"a_b_._/{name}"] for name in different)
    assert manifest.frames[0]["digest"] == frame_entry(ThreeCameraStream(buffers)[0], {})["digest"]


def test_recordings_of_scenarios_and_cameras_have_ids_of_their_own(tmp_path, monkeypatch):
    """Rerun joins files with the id of one recording: they would lie over each other."""
    skip_without_extra("rerun")
    from rerun.chunk import RrdReader

    from tiscene.export import rerun_recording

    monkeypatch.setattr(rerun_recording, "FRAMES_PER_FILE", 2)
    ids: dict[tuple[int, str], set[str]] = {}
    for number in (1, 2):
        stream = ThreeCameraStream(("depth",))
        stream.scenario = SimpleNamespace(to_json=lambda number=number: {"scene": "nowhere", "number": number})
        export(stream, tmp_path / str(number), format="rerun", frames=range(3))
        for path in (tmp_path / str(number)).rglob("*.rrd"):
            (entry,) = RrdReader(path).recordings()
            ids.setdefault((number, path.parent.name), set()).add(entry.recording_id)
    assert len(ids) == 6
    assert {len(each) for each in ids.values()} == {1}
    assert len(set.union(*ids.values())) == 6


def test_export_of_several_cameras_is_continued_and_replaced(tmp_path):
    export(ThreeCameraStream(), tmp_path, frames=range(3))
    before = contents(tmp_path)
    (tmp_path / "a_b_._" / "rgb" / "000001.png").unlink()
    again, seen = ThreeCameraStream(), []
    export(again, tmp_path, frames=range(3), progress=lambda index, frame: seen.append(frame is None))
    assert seen == [True, False, True]
    assert contents(tmp_path) == before
    export(FakeStream(seed=1), tmp_path, frames=range(1), overwrite=True)
    assert not [name for name in contents(tmp_path) if name.startswith(("Main", "Over", "a_b"))]


def test_camera_whose_name_is_that_of_a_folder_of_exports_has_another_one(tmp_path):
    stream = ThreeCameraStream()
    stream.names = ("pieces", "Shards")
    for _ in range(2):
        assert export(stream, tmp_path, format="webdataset", frames=range(2)).folders == ["Shards_/", "pieces_/"]
    assert set(contents(tmp_path)) == {NAME, "Shards_/shard-000000.tar", "pieces_/shard-000000.tar"}


def test_camera_without_a_name_has_a_folder(tmp_path):
    stream = ThreeCameraStream()
    stream.names = ("", "..", "Main")
    assert export(stream, tmp_path, frames=range(1)).folders == ["Main/", "_/", "__/"]


def test_cameras_with_equal_folder_names_are_refused(tmp_path):
    stream = ThreeCameraStream()
    stream.names = ("a/b", "A:B")
    with pytest.raises(ExportError, match="two of the cameras 'a/b', 'A:B' would write into the folder 'A_B/'"):
        export(stream, tmp_path, frames=range(1))


def test_progress_is_not_told_of_frames_that_further_ones_need_again(tmp_path):
    export(fake_stream_for("kitti-flow"), tmp_path, format="kitti-flow", frames=(1, 2))
    again, seen = fake_stream_for("kitti-flow"), []
    export(again, tmp_path, format="kitti-flow", frames=[0], progress=lambda index, frame: seen.append(index))
    assert again.rendered == [1, 0]
    assert seen == [0]
