# SPDX-License-Identifier: Apache-2.0
"""Shards: disjoint, complete, idempotent; merged they have the bytes of an export in one go."""

import errno
import json
import os
from pathlib import Path

import pytest

from tests.export.fake_stream import FAKE_FORMATS, FakeStream, fake_stream_for, skip_without_extra
from tests.export.folders import contents, merged
from tests.export.test_killed_exports import small_files
from tiscene.errors import ArgumentError, ExportError
from tiscene.export import export
from tiscene.export.merging import merge
from tiscene.export.shards import SHARDS, Shard, machine

FRAMES = range(2, 13)


def render_shard(folder, number, count, format="png", stream=None, machine=machine()):  # noqa: B008
    shard = Shard(number, count, (FRAMES.start, FRAMES.stop, FRAMES.step), machine)
    part = shard.folder(folder)
    export(stream or fake_stream_for(format), part, format=format, frames=shard.own_frames, pack=False)
    shard.save(part)
    return part


@pytest.mark.parametrize("count", [1, 3, 8, 20])
def test_shards_are_disjoint_and_complete_runs_of_frames(count):
    shards = [Shard(number, count, (FRAMES.start, FRAMES.stop, FRAMES.step)) for number in range(count)]
    assert [index for shard in shards for index in shard.own_frames] == list(FRAMES)


def test_merge_on_a_full_disk_leaves_no_partial_files(tmp_path, monkeypatch):
    render_shard(tmp_path, 0, 1)

    def half_a_file(_, target):
        Path(target).write_bytes(b"half")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("os.link", half_a_file)
    monkeypatch.setattr("shutil.copyfile", half_a_file)
    with pytest.raises(ExportError, match="No space left"):
        merge(tmp_path)
    assert not list(tmp_path.rglob("*.part"))


@pytest.mark.parametrize("format", FAKE_FORMATS)
def test_merged_shards_have_the_bytes_of_one_export(tmp_path, monkeypatch, format):
    skip_without_extra(format)
    small_files(format, monkeypatch.setattr)
    export(fake_stream_for(format), tmp_path / "whole", format=format, frames=FRAMES)
    for number in (2, 1):
        render_shard(tmp_path / "out", number, 4, format)
    merge(tmp_path / "out", partial=True)
    for number in (0, 3, 1):  # in any order, one twice
        render_shard(tmp_path / "out", number, 4, format)
    for _ in range(2):
        merge(tmp_path / "out")
        assert merged(tmp_path / "out") == contents(tmp_path / "whole")


def test_missing_shard_and_frames_are_named_until_they_are_there(tmp_path):
    render_shard(tmp_path, 0, 3)
    stream = FakeStream()
    stream.interrupt_at = 8
    with pytest.raises(KeyboardInterrupt):
        render_shard(tmp_path, 1, 3, stream=stream)
    Shard(1, 3, (2, 13, 1), machine()).save(tmp_path / SHARDS / "00001-of-00003")
    with pytest.raises(ExportError, match=r"5 frames are missing, the first is 8: render the shards 1/3, 2/3"):
        merge(tmp_path)
    partial = merge(tmp_path, partial=True)
    assert list(partial.frames) == [2, 3, 4, 5, 6, 7]
    render_shard(tmp_path, 1, 3)
    stream.interrupt_at = 12
    with pytest.raises(KeyboardInterrupt):
        render_shard(tmp_path, 2, 3, stream=stream)
    with pytest.raises(ExportError, match=r"1 frame is missing, the first is 12: render the shards 2/3 "):
        merge(tmp_path)
    render_shard(tmp_path, 2, 3)
    assert list(merge(tmp_path).frames) == list(FRAMES)


def test_merged_shards_have_the_categories_and_materials_of_all(tmp_path):
    """Objects that are spawned late are in the frames of later shards alone."""
    for number in (0, 1):
        stream = FakeStream()
        stream.categories, stream.materials = {1 + number: f"category {number}"}, {1 + number: f"material {number}"}
        render_shard(tmp_path, number, 2, stream=stream)
    manifest = merge(tmp_path)
    assert manifest.categories == {1: "category 0", 2: "category 1"}
    assert manifest.materials == {1: "material 0", 2: "material 1"}


def test_parts_that_do_not_belong_together_are_refused(tmp_path):
    render_shard(tmp_path / "a", 0, 2)
    part = render_shard(tmp_path / "b", 1, 2, stream=FakeStream(seed=5))
    with pytest.raises(ExportError, match=r"have other settings:\s+settings\.seed: 0 in the folder, 5 requested"):
        merge(tmp_path / "out", [tmp_path / "a" / SHARDS / "00000-of-00002", part])
    with pytest.raises(ExportError, match="has no shards"):
        merge(tmp_path / "nothing")
    export(fake_stream_for("webdataset"), tmp_path / "packed", format="webdataset", frames=FRAMES)
    with pytest.raises(ExportError, match="holds files of many frames, which cannot be merged"):
        merge(tmp_path / "out", [tmp_path / "packed"])
    with pytest.raises(ArgumentError, match=r"shard 4/4: must be 0/N to 3/N"):
        Shard(4, 4, (0, 8, 1))


def test_file_of_many_frames_is_not_extended_without_the_parts_that_it_was_merged_of(tmp_path):
    first, second = (render_shard(tmp_path, number, 2, "webdataset") for number in (0, 1))
    merge(tmp_path, [first], partial=True)
    before = merged(tmp_path)
    with pytest.raises(ExportError, match=r"frames that are in no part now, such as 2: name all parts that it was"):
        merge(tmp_path, [second], partial=True)
    assert merged(tmp_path) == before
    assert list(merge(tmp_path, [first, second]).frames) == list(FRAMES)


def test_folder_of_another_export_is_refused_or_replaced(tmp_path):
    export(FakeStream(seed=5), tmp_path, frames=range(20))
    render_shard(tmp_path, 0, 1)
    with pytest.raises(ExportError, match=r"settings\.seed: 5 in the folder, 0 requested"):
        merge(tmp_path)
    merge(tmp_path, overwrite=True)
    export(FakeStream(), tmp_path.parent / "whole", frames=FRAMES)
    assert merged(tmp_path) == contents(tmp_path.parent / "whole")


def test_parts_of_unlike_machines_are_merged_only_on_request(tmp_path):
    render_shard(tmp_path, 0, 2)
    render_shard(tmp_path, 1, 2, machine=machine() | {"numpy": "0.9"})
    with pytest.raises(ExportError, match=r"unlike machines \(numpy\)"):
        merge(tmp_path)
    assert list(merge(tmp_path, unlike=True).frames) == list(FRAMES)


def test_all_shards_with_damaged_files_are_named_before_anything_is_written(tmp_path):
    parts = [render_shard(tmp_path, number, 3) for number in range(3)]
    (parts[0] / "rgb" / "000004.png").write_bytes(b"damaged")
    (parts[2] / "depth" / "000010.png").unlink()
    with pytest.raises(ExportError, match=r"2 files .* first is .*000004\.png': render the shards 0/3, 2/3 \(again\)"):
        merge(tmp_path)
    assert not merged(tmp_path)
    (parts[0] / "shard.json").unlink()
    with pytest.raises(ExportError, match=r"render the shards '.*00000-of-00003', 2/3 \(again\)"):
        merge(tmp_path / "out", parts)
    assert not (tmp_path / "out").exists()


def test_differing_frame_of_a_part_is_refused(tmp_path):
    part = render_shard(tmp_path, 0, 1)
    other = tmp_path / "other"
    export(FakeStream(), other, frames=[4])
    manifest = json.loads((other / "tiscene.json").read_text())
    manifest["frames"]["4"]["digest"] = "0"
    (other / "tiscene.json").write_text(json.dumps(manifest))
    with pytest.raises(ExportError, match="frame 4 differs between"):
        merge(tmp_path / "merged", [part, other])
