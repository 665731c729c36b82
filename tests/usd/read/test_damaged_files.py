# SPDX-License-Identifier: Apache-2.0
"""Damaged files give errors, never a crash and never another exception.

A few of a thousand keep USD itself busy for minutes: it believes a damaged count. Those are given up after a while.
"""

from __future__ import annotations

import random
import signal
import subprocess
import sys

import pytest
from pxr import Usd

from tests.usd.helpers import STAGES

CHILD = """
import signal, sys, warnings
from tiscene.errors import TisceneError
from tiscene.usd.read.stage_reader import read_stage
warnings.simplefilter("ignore")
for path in sys.argv[1:]:
    signal.alarm(5)  # ends the process
    try:
        read_stage(path)
        print("read", path, flush=True)
    except TisceneError:
        print("refused", path, flush=True)
"""


def damaged(data: bytes, rng: random.Random) -> bytes:
    """A few bits flipped; one in ten also cut off."""
    result = bytearray(data)
    for _ in range(rng.choice([1, 1, 2, 4, 16])):
        result[rng.randrange(len(result))] ^= 1 << rng.randrange(8)
    return bytes(result[: rng.randrange(len(result))] if rng.random() < 0.1 else result)


@pytest.mark.parametrize("count", [40, pytest.param(400, marks=pytest.mark.slow)])
@pytest.mark.parametrize("suffix", ["usdc", "usda"])
def test_random_damage(tmp_path, suffix, count):
    rng = random.Random(count)
    sources = []
    for name in ("instances", "scatter", "subsets", "creases", "skinned"):
        path = tmp_path / f"{name}.{suffix}"
        Usd.Stage.Open(str(STAGES / f"{name}.usda")).Export(str(path))
        sources.append(path.read_bytes())
    files = []
    for number in range(count):
        path = tmp_path / f"damaged_{number}.{suffix}"
        path.write_bytes(damaged(rng.choice(sources), rng))
        files.append(str(path))
    answers = []
    given_up = 0
    while len(answers) < count:
        done = subprocess.run(
            [sys.executable, "-c", CHILD, *files[len(answers) :]], capture_output=True, timeout=600, check=False
        )
        lines = [line.split(" ", 1) for line in done.stdout.decode().splitlines()]
        assert [path for _, path in lines] == files[len(answers) : len(answers) + len(lines)]
        answers += [answer for answer, _ in lines]
        if len(answers) < count:
            assert done.returncode == -signal.SIGALRM, done.stderr.decode(errors="replace")[-2000:]
            answers.append("given up")
            given_up += 1
    assert {"read", "refused"} <= set(answers)
    assert given_up <= count // 50
