# SPDX-License-Identifier: Apache-2.0
"""Everything that runs kernels gives the same without tiscene's patches of Taichi."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.reproducibility.digests import differences, load

ROOT = Path(__file__).parents[2]
# The suite's fast tests of kernels, and of what hands them their arguments. The others never launch one, or test the
# patches themselves.
KERNEL_TESTS = ("tests/dynamics", "tests/world", "tests/scene", "tests/render", "tests/stream", "tests/reproducibility")
PROGRAM = """
import json
from tests.reproducibility.digests import digests
print(json.dumps(digests()))
"""


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python with Taichi as it is."""
    environment = {**os.environ, "TISCENE_TAICHI_PATCHES": "0"}
    return subprocess.run([sys.executable, *arguments], env=environment, cwd=ROOT, capture_output=True, text=True)


@pytest.mark.slow
def test_digests_are_the_same_without_patches():
    done = run("-W", "ignore", "-c", PROGRAM)
    assert done.returncode == 0, done.stderr[-2000:]
    assert differences(load(), json.loads(done.stdout.splitlines()[-1])) == []


@pytest.mark.slow
@pytest.mark.parametrize("folder", KERNEL_TESTS)
def test_fast_tests_of_kernels_pass_without_patches(folder):
    done = run("-m", "pytest", "-q", "-p", "no:cacheprovider", folder)
    assert done.returncode == 0, done.stdout[-6000:]
