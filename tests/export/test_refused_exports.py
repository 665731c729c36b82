# SPDX-License-Identifier: Apache-2.0
"""What a format cannot write, and what would replace files of others, is refused before anything is rendered."""

import pytest

from tests.export.fake_stream import FAKE_FORMATS, FakeStream, fake_stream_for, skip_without_extra
from tests.export.folders import contents, merged
from tiscene.errors import ArgumentError, ExportError
from tiscene.export import export
from tiscene.export.formats import FORMATS
from tiscene.export.manifest import NAME, Manifest
from tiscene.export.merging import merge
from tiscene.export.shards import Shard

KITTI = FORMATS["kitti-flow"].buffers


def export_pairs(folder, frames, **arguments):
    stream = FakeStream(KITTI)
    export(stream, folder, format="kitti-flow", frames=frames, **arguments)
    return stream.rendered


def pictures(folder):
    return sorted(path.name for path in folder.rglob("image_2/*"))


@pytest.mark.parametrize("format", [name for name, form in FORMATS.items() if form.optional is not None])
def test_buffers_that_a_format_does_not_write_are_refused(tmp_path, format):
    skip_without_extra(format)
    form = FORMATS[format]
    stream = FakeStream((*form.buffers, "depth", "uv"))
    kept = ",".join(form.buffers)
    with pytest.raises(ExportError, match=rf"format='{format}' does not write 'depth', 'uv': .* \(--buffers {kept}\)"):
        export(stream, tmp_path / "out", format=format, frames=range(2))
    with pytest.raises(ArgumentError, match=rf"requires .* and does not write 'depth': .* \(--buffers {kept}\)"):
        export(FakeStream(("depth",)), tmp_path / "out", format=format, frames=range(2))
    assert not stream.rendered
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("format", ["npz", "webdataset"])
@pytest.mark.parametrize(
    ("frames", "message"),
    [
        (range(3, 7), "no frame 5: there are 0 to 4"),
        (range(-6, 0), "no frame -6: there are 0 to 4"),
        ([0, 5, 1], "no frame 5: there are 0 to 4"),
        ([1.0], r"frames=\[1\.0\]: must be frame indices"),
        (5, "frames=5: must be frame indices, such as"),
    ],
)
def test_frames_that_a_stream_does_not_have_are_refused(tmp_path, format, frames, message):
    stream = FakeStream(("depth",), frames=5)
    with pytest.raises(ArgumentError, match=message):
        export(stream, tmp_path / "out", format=format, frames=frames)
    assert not stream.rendered
    assert not (tmp_path / "out").exists()


def test_negative_frames_are_those_from_the_end_of_a_finite_stream(tmp_path):
    for name, frames in {"a": range(3, 5), "b": [-2, -1], "c": range(-2, 0)}.items():
        export(FakeStream(("depth",), frames=5), tmp_path / name, format="webdataset", frames=frames)
    assert contents(tmp_path / "a") == contents(tmp_path / "b") == contents(tmp_path / "c")
    with pytest.raises(ArgumentError, match="no frame -1: the stream is endless"):
        export(FakeStream(("depth",)), tmp_path / "d", frames=[-1])


def test_second_picture_of_mattes_is_refused():
    with pytest.raises(ExportError, match="writes the buffer 'hdr' or 'rgb' as its picture"):
        FORMATS["cryptomatte"].check(("rgb", "hdr", "coverage", "material_coverage"))


@pytest.mark.parametrize("frames", [range(1, 9, 3), [0, 1, 3]])
def test_pairs_of_frames_that_are_not_consecutive_are_refused(tmp_path, frames):
    with pytest.raises(ExportError, match=r"pairs of consecutive frames, .*\(--frames \d:\d\)"):
        export_pairs(tmp_path / "out", frames)
    assert not (tmp_path / "out").exists()
    export_pairs(tmp_path, range(2))
    with pytest.raises(ExportError, match=r"these are 3 of the frames 0 to 3"):
        export_pairs(tmp_path, [3])
    assert list(Manifest.load(tmp_path).frames) == [0, 1]


def test_pairs_begin_with_the_first_frame_of_the_export_also_when_earlier_ones_are_added(tmp_path):
    export_pairs(tmp_path / "late", range(2, 5))
    pairs = ["000002_10.png", "000002_11.png", "000003_10.png", "000003_11.png", "000004_10.png"]
    assert pictures(tmp_path / "late") == pairs
    assert export_pairs(tmp_path / "late", range(2, 5)) == []
    assert export_pairs(tmp_path / "late", range(2)) == [2, 0, 1]
    export_pairs(tmp_path / "whole", range(5))
    assert contents(tmp_path / "late") == contents(tmp_path / "whole")


def test_pairs_of_merged_shards_begin_with_the_first_frame_of_the_export(tmp_path):
    for number in range(2):
        shard = Shard(number, 2, (2, 6, 1), {})
        export_pairs(shard.folder(tmp_path / "out"), shard.own_frames, pack=False)
        shard.save(shard.folder(tmp_path / "out"))
    export_pairs(tmp_path / "whole", range(2, 6))
    merge(tmp_path / "out")
    assert merged(tmp_path / "out") == contents(tmp_path / "whole")


@pytest.mark.parametrize("format", FAKE_FORMATS)
def test_files_of_others_are_not_replaced(tmp_path, format):
    skip_without_extra(format)
    manifest = export(fake_stream_for(format), tmp_path / "whole", format=format, frames=range(5))
    names = [name for name in manifest.frames[4]["files"] if "labels" not in name]
    for number, name in enumerate([*names[:4], *getattr(FORMATS[format].writer(), "SUMMARY", ())]):
        folder = tmp_path / str(number)
        (folder / name).parent.mkdir(parents=True)
        (folder / name).write_bytes(b"mine")
        (folder / "notes.txt").write_bytes(b"mine")
        before = contents(folder)
        for overwrite in (False, True):
            with pytest.raises(ExportError, match=rf"{name}' is there and is not of this export"):
                export(fake_stream_for(format), folder, format=format, frames=range(5), overwrite=overwrite)
        assert contents(folder) == before
        (folder / name).unlink()
        export(fake_stream_for(format), folder, format=format, frames=range(5))
        assert contents(folder).pop("notes.txt") == b"mine"


def test_merge_does_not_replace_files_of_others(tmp_path):
    shard = Shard(0, 1, (0, 3, 1), {})
    export(FakeStream(), shard.folder(tmp_path), frames=range(3), pack=False)
    (tmp_path / "rgb").mkdir()
    (tmp_path / "rgb" / "000002.png").write_bytes(b"mine")
    before = contents(tmp_path)
    with pytest.raises(ExportError, match=r"rgb/000002\.png' is there and is not of this export"):
        merge(tmp_path)
    assert contents(tmp_path) == before


def test_export_without_frames_has_a_manifest(tmp_path):
    export(FakeStream(), tmp_path, frames=range(0))
    assert set(contents(tmp_path)) == {NAME}


def test_overwrite_replaces_what_a_killed_export_has_left(tmp_path):
    export(FakeStream(seed=1), tmp_path, frames=range(1))
    (tmp_path / "rgb" / "000001.png").write_bytes(b"not in the manifest yet")
    export(FakeStream(seed=2), tmp_path, frames=range(2), overwrite=True)
    assert list(Manifest.load(tmp_path).frames) == [0, 1]
    stream = FakeStream(("depth",), seed=3)
    stream.interrupt_at = 2
    with pytest.raises(KeyboardInterrupt):
        export(stream, tmp_path / "shards", format="webdataset", frames=range(3))
    (tmp_path / "shards" / "pieces" / "000002.bin").write_bytes(b"not in the manifest yet")
    export(FakeStream(("depth",)), tmp_path / "shards", format="npz", frames=range(1), overwrite=True)
    names = {path.name for path in (tmp_path / "shards").iterdir()}
    assert names == {"000000.npz", "labels", NAME}
