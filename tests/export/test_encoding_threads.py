# SPDX-License-Identifier: Apache-2.0
"""Frames are encoded in threads: they finish in order, few wait at a time, and errors lose no other frame."""

import sys
import threading
import time

import pytest

from tests.export.fake_stream import FakeStream
from tiscene.errors import ExportError
from tiscene.export import Format, encoding_threads, export, formats, register_format
from tiscene.export.manifest import Manifest

FRAMES = 12


class SlowFormat:
    """A format whose first frame takes long to encode; notes the threads, and how many frames are being encoded."""

    def __init__(self) -> None:
        self.threads: set[int] = set()
        self.waiting, self.most, self.lock = 0, 0, threading.Lock()

    def encode(self, frame):
        with self.lock:
            self.waiting += 1
            self.most = max(self.most, self.waiting)
        return {f"{frame.index:06d}.txt": lambda: self.text(frame.index)}

    def text(self, index):
        time.sleep(0.2 if index == 0 else 0.001)
        if index == 5:
            raise ExportError("frame 5 cannot be encoded")
        with self.lock:
            self.waiting -= 1
        self.threads.add(threading.get_ident())
        return b"%d" % index


@pytest.fixture
def slow(monkeypatch):
    monkeypatch.setattr(formats, "FORMATS", dict(formats.FORMATS))
    module = SlowFormat()
    monkeypatch.setitem(sys.modules, "slow", module)
    register_format(Format("slow", "slow", "text", "tests"))
    return module


def test_frames_finish_in_order_and_few_wait(tmp_path, slow, monkeypatch):
    monkeypatch.setattr(encoding_threads, "MAX_THREADS", 2)
    seen = []
    indices = [index for index in range(FRAMES) if index != 5]
    export(FakeStream(), tmp_path, format="slow", frames=indices, progress=lambda index, frame: seen.append(index))
    assert seen == indices
    assert slow.most <= 3  # those that wait, and the one that was rendered last
    assert threading.get_ident() not in slow.threads
    assert (tmp_path / "000007.txt").read_bytes() == b"7"


def test_error_of_a_thread_is_raised_and_loses_no_other_frame(tmp_path, slow):
    with pytest.raises(ExportError, match="frame 5 cannot be encoded"):
        export(FakeStream(), tmp_path, format="slow", frames=range(FRAMES))
    written = set(Manifest.load(tmp_path).frames)
    assert {0, 1, 2, 3, 4} <= written
    assert 5 not in written
    assert all((tmp_path / f"{index:06d}.txt").is_file() for index in written)
