# SPDX-License-Identifier: Apache-2.0
"""Each worker thread is bound to a core of its own, where there are as many workers as cores."""

import json
import os
import sys

import pytest

from tests.device.programs import run_python

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="threads are bound on Linux only")

# Arguments: the number of threads, or "all". Prints the cores that the threads that run a kernel may use.
PROGRAM = """
import json, os, sys
from pathlib import Path
from tiscene.device import runtime

runtime.start(threads=None if sys.argv[1] == "all" else int(sys.argv[1]))
import taichi as ti

@ti.kernel
def work(values: ti.types.ndarray(dtype=ti.f32, ndim=1)):
    ti.loop_config(block_dim=64)
    for i in values:
        for k in range(40):
            values[i] = ti.sin(values[i]) + 1.0

def slices(thread):
    return int((Path("/proc/self/task") / thread / "schedstat").read_text().split()[2])

values = ti.ndarray(ti.f32, 1 << 16)
work(values)
before = {thread: slices(thread) for thread in os.listdir("/proc/self/task") if thread != str(os.getpid())}
for _ in range(50):
    work(values)
workers = [int(thread) for thread, count in before.items() if slices(thread) > count + 20]
print(json.dumps([sorted(os.sched_getaffinity(thread)) for thread in (0, *workers)]))
"""


@pytest.fixture
def program(tmp_path):
    path = tmp_path / "program.py"  # Taichi reads the source of kernels
    path.write_text(PROGRAM)
    return str(path)


def test_workers_are_bound_to_all_cores_and_the_main_thread_to_none(program):
    mine = sorted(os.sched_getaffinity(0))
    main, *workers = json.loads(run_python(program, "all"))
    assert main == mine
    assert sorted(workers) == [[core] for core in mine]


@pytest.mark.slow
@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="needs two cores")
def test_fewer_workers_than_cores_are_not_bound(program):
    mine = sorted(os.sched_getaffinity(0))
    assert json.loads(run_python(program, "1")) == [mine, mine]
