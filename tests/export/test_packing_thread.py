# SPDX-License-Identifier: Apache-2.0
"""Files of many frames are written while later frames are rendered, and are those that are written afterwards."""

import threading

import pytest

from tests.export.fake_stream import FakeStream, fake_stream_for, skip_without_extra
from tests.export.folders import contents
from tiscene.errors import ExportError
from tiscene.export import export, provenance
from tiscene.export.array_files import resolved
from tiscene.export.formats import find_format
from tiscene.export.packing import PACKING, ExportRun, GroupFrames, pieces_file

EARLY = ["webdataset", "parquet", "video", "mcap", "rerun"]


@pytest.mark.parametrize("format", EARLY)
def test_frames_in_any_order_give_the_bytes_of_packing_at_the_end(tmp_path, monkeypatch, format):
    skip_without_extra(format)
    writer = find_format(format).writer()
    assert writer.READS_ONCE
    if writer.FRAMES_PER_FILE is not None:
        monkeypatch.setattr(writer, "FRAMES_PER_FILE", 3)
    orders = range(7), range(6, -1, -1), (3, 0, 6, 1, 5, 2, 4)
    for number, order in enumerate(orders):
        export(fake_stream_for(format), tmp_path / str(number), format=format, frames=order)
    monkeypatch.setattr(writer, "READS_ONCE", False)
    export(fake_stream_for(format), tmp_path / "late", format=format, frames=range(7))
    late = contents(tmp_path / "late")
    assert all(contents(tmp_path / str(number)) == late for number in range(len(orders)))


def failing(frames: int, error: type[BaseException]) -> FakeStream:
    """Return a stream that fails at a frame."""
    stream = FakeStream(("instance", "depth"))

    class Failing:
        def __getattr__(self, name):
            return getattr(stream, name)

        def __getitem__(self, index):
            if index == frames:
                raise error
            return stream[index]

    return Failing()


@pytest.mark.parametrize("format", EARLY)
@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_export_that_ends_early_stops_the_thread_and_is_continued(tmp_path, format, error):
    skip_without_extra(format)
    with pytest.raises(error):
        export(failing(5, error), tmp_path / "out", format=format, frames=range(8))
    assert not any(thread.name.startswith("tiscene-pack") for thread in threading.enumerate())
    assert not (tmp_path / "out" / PACKING).exists()
    export(FakeStream(("instance", "depth")), tmp_path / "out", format=format, frames=range(8))
    export(FakeStream(("instance", "depth")), tmp_path / "whole", format=format, frames=range(8))
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


def test_error_of_packing_ends_the_export_while_frames_are_rendered(tmp_path, monkeypatch):
    skip_without_extra("mcap")
    writer = find_format("mcap").writer()

    def pack(frames, run, folder):
        next(iter(frames))
        raise ExportError("no room")

    monkeypatch.setattr(writer, "pack", pack)
    stream = FakeStream(("depth",))
    with pytest.raises(ExportError, match="no room"):
        export(stream, tmp_path, format="mcap", frames=range(200))
    assert len(stream.rendered) < 200


def test_recording_of_rerun_that_cannot_be_written_is_an_export_error(tmp_path):
    skip_without_extra("rerun")
    writer, stream = find_format("rerun").writer(), FakeStream(("depth",))
    (data,) = resolved(pieces_file(0, writer.pieces(stream[0], {}, stream))).values()
    (tmp_path / "0.bin").write_bytes(data)
    run = ExportRun(provenance(stream, "rerun", None), {}, [0])
    with pytest.raises(ExportError, match=r"cannot write '.*recording-000000\.rrd': No such file"):
        writer.pack(GroupFrames({0: tmp_path / "0.bin"}, ""), run, tmp_path / "gone")
