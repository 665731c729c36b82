# SPDX-License-Identifier: Apache-2.0
"""Damaged files raise a TisceneError or are read: no other exception, no file that is read without end.

Where USD itself ends the process, `untrusted=True` raises too.
"""

from __future__ import annotations

import os
import random
from pathlib import Path

import pytest

from tests.usd.damage import CRASHED, READ, REFUSED, STOPPED, crate_bytes, damaged, read_all
from tests.usd.helpers import STAGES
from tiscene.errors import StageError
from tiscene.usd.core.limits import Limits
from tiscene.usd.read.stage_reader import read_stage

pytestmark = pytest.mark.skipif(os.name != "posix", reason="limits of processes need POSIX")
SOURCES = ("instances", "scatter", "subsets", "creases", "skinned")


def damaged_files(folder: Path, suffix: str, count: int) -> list[Path]:
    """Write damaged copies of the small stages; their bytes depend on the suffix and the count alone."""
    rng = random.Random(count)
    sources = [crate_bytes((STAGES / f"{name}.usda").read_text(encoding="utf-8"), folder, suffix) for name in SOURCES]
    files = [folder / f"damaged_{number}.{suffix}" for number in range(count)]
    for path in files:
        path.write_bytes(damaged(rng.choice(sources), rng))
    return files


@pytest.mark.parametrize("count", [40, pytest.param(400, marks=pytest.mark.slow)])
@pytest.mark.parametrize("suffix", ["usdc", "usda"])
def test_randomly_damaged_stages_are_read_or_refused(tmp_path, suffix, count):
    files = damaged_files(tmp_path, suffix, count)
    reader, binary = "tiscene.usd.read.stage_reader:read_stage", suffix == "usdc"
    outcomes = read_all(reader, files, seconds=20.0, total=120.0 + count, crashes=binary)
    assert {READ, REFUSED} <= set(outcomes)
    assert outcomes.count(STOPPED) <= count // 50  # a damaged count can keep USD itself busy
    # USD 26.11 aborts at one of 400 damaged crates, in the process that reads it: a child, if it is not trusted.
    crashed = [file for file, outcome in zip(files, outcomes, strict=True) if outcome == CRASHED]
    assert len(crashed) <= count // 100
    for file in crashed:
        with pytest.raises(StageError, match="it crashes USD"):
            read_stage(file, untrusted=True)


def test_text_that_is_not_utf8_raises_stage_error(tmp_path):
    data = crate_bytes('#usda 1.0\n(\n    upAxis = "QQ"\n)\ndef Cube "A" {}\n', tmp_path)
    assert data.count(b"QQ") == 1
    path = tmp_path / "damaged.usdc"
    path.write_bytes(data.replace(b"QQ", b"\xd9\xff"))
    with pytest.raises(StageError, match="cannot be read: a text in it is not valid UTF-8"):
        read_stage(path)


def test_crate_that_hangs_usd_is_stopped_at_the_time_limit(tmp_path):
    """One flipped bit gives a count that USD believes for minutes. The file is trusted: limits alone bound it."""
    data = bytearray(crate_bytes((STAGES / "creases.usda").read_text(encoding="utf-8"), tmp_path))
    data[1354] ^= 1
    path = tmp_path / "damaged.usdc"
    path.write_bytes(data)
    with pytest.raises(StageError, match=r"damaged.usdc has 1 problem:\n  reading it took longer than 2 s: the"):
        read_stage(path, limits=Limits(seconds=2.0))
