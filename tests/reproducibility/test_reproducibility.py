# SPDX-License-Identifier: Apache-2.0
"""Frames have the same bytes in any process, for any number of threads, and with other instructions of the CPU."""

import json
import os
import subprocess
import sys

import pytest

from tests.reproducibility.digests import differences, digests, load

PROGRAM = """
import json, sys
from tiscene.device import runtime
runtime.start(threads={threads})
from tests.reproducibility.digests import digests
print(json.dumps(digests()))
"""
# glibc and numpy choose other code without these.
WITHOUT_VECTORS = {
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F",
    "NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3 AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL",
}


def test_frames_have_the_digests_of_the_repository():
    assert differences(load(), digests()) == []


@pytest.mark.slow
@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("environment", [{}, WITHOUT_VECTORS], ids=["", "masked CPU features"])
def test_another_process_gives_the_same_bytes(threads, environment):
    program = PROGRAM.format(threads=threads)
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", program], env=os.environ | environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert differences(load(), json.loads(done.stdout)) == []
