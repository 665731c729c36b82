# SPDX-License-Identifier: Apache-2.0
"""Starting Taichi: once, as asked, and with a message when that cannot be. Each case in a process of its own."""

import subprocess
import sys

import pytest

from tiscene.device import runtime
from tiscene.device.vector_mode import vector_mode
from tiscene.errors import ArgumentError


def python(code: str) -> str:
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


CAUGHT = """
import taichi as ti
from tiscene.device import runtime
from tiscene.errors import TisceneError
{before}
try:
    runtime.start({arguments})
except TisceneError as error:
    print(type(error).__name__, error)
"""


def test_starting_is_silent_and_happens_once():
    printed = python(
        "from tiscene.device import runtime\n"
        "before = runtime.running()\n"
        "first = runtime.start(threads=1)\n"
        "import taichi as ti\n"
        "program = ti.lang.impl.get_runtime().prog\n"
        "again = runtime.start(), runtime.start('cpu')\n"
        "same = ti.lang.impl.get_runtime().prog is program\n"
        "print(before, first, *again, same, ti.cfg.fast_math, ti.cfg.cpu_max_num_threads)"
    )
    assert printed == "None cpu cpu cpu True False 1"


def test_a_running_taichi_is_used_as_it_is():
    printed = python(
        "import taichi as ti\n"
        "ti.init(arch=ti.cpu, fast_math=False, log_level=ti.ERROR, cpu_max_num_threads=1)\n"
        "values = ti.ndarray(ti.f32, 3)\n"
        "values.fill(4.0)\n"
        "from tiscene.device import runtime\n"
        "print(runtime.start(), values.to_numpy().sum())"
    )
    assert printed.splitlines()[-1].endswith("cpu 12.0")


def test_a_running_taichi_with_fast_math_is_refused():
    start = "ti.init(arch=ti.cpu, log_level=ti.ERROR, cpu_max_num_threads=1)"
    printed = python(CAUGHT.format(before=start, arguments="")).splitlines()[-1]
    assert "DeviceError this process started Taichi with fast_math=True" in printed
    assert "fast_math=False" in printed


def test_one_process_has_one_architecture():
    printed = python(CAUGHT.format(before="runtime.start()", arguments="'cuda'")).splitlines()[-1]
    assert printed == "DeviceError arch='cuda', but this process already runs Taichi on 'cpu'; use a new process"


def test_a_missing_gpu_is_told():
    code = CAUGHT.format(before="import os; os.environ['CUDA_VISIBLE_DEVICES'] = '-1'", arguments="'cuda'")
    assert python(code).splitlines()[-1] == "DeviceError arch='cuda': Taichi finds no such device here; use arch='cpu'"


def test_an_unknown_architecture_is_refused():
    with pytest.raises(ArgumentError, match="arch='gpu': must be one of cpu, cuda"):
        runtime.start("gpu")


def test_vector_mode_is_left_again_even_after_an_error():
    import taichi as ti

    def fail_inside() -> None:
        with vector_mode():
            assert not ti.cfg.real_matrix_scalarize
            raise KeyError

    before = ti.cfg.real_matrix_scalarize
    with pytest.raises(KeyError):
        fail_inside()
    assert ti.cfg.real_matrix_scalarize == before


def test_a_fork_of_a_process_that_runs_taichi_says_so_instead_of_waiting_for_ever():
    printed = python(
        "import os, sys\n"
        "import tiscene as ts\n"
        "from tiscene.errors import DeviceError\n"
        "stream = ts.Stream('object_view', width=8, height=8, buffers=('depth',))\n"
        "if os.fork():\n"
        "    os.wait()\n"
        "    sys.exit()\n"
        "for use in (lambda: stream[0], lambda: ts.Stream('object_view')):\n"
        "    try:\n"
        "        use()\n"
        "    except DeviceError as error:\n"
        "        print(error, flush=True)\n"
        "os._exit(0)"
    )
    assert printed.count("multiprocessing_context='spawn'") == 2
