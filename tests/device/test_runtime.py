# SPDX-License-Identifier: Apache-2.0
"""Taichi is started once, with the options that were asked for, or an error says why not."""

import json
import re
import threading

import pytest
import taichi as ti

from tests.device.programs import run_python
from tiscene.device import memory, runtime
from tiscene.device.taichi_patches import ast_recorder, fence
from tiscene.errors import ArgumentError

INIT = "ti.init(arch=ti.cpu, log_level=ti.ERROR, cpu_max_num_threads=1, {})".format
NO_GPU = "os.environ.update(CUDA_VISIBLE_DEVICES='-1', {})".format
CHANGED = (
    r"DeviceError this process started Taichi with {}, which changes.* Start it with ti\.init\({}, \.\.\.\).*".format
)
MISSING = r"DeviceError arch='cuda': Taichi finds no such device here; use arch='cpu'"
SECOND = (
    r"DeviceError arch='cuda', but this process already runs Taichi on 'cpu'.* a new process, with TISCENE_ARCH=cuda.*"
)
# What a process does, the arguments of its `runtime.start`, and the error.
REFUSED = [
    (INIT(""), "", CHANGED("fast_math=True", "fast_math=False")),
    (INIT("fast_math=False, default_fp=ti.f64"), "", CHANGED("default_fp=ti.f64", "default_fp=ti.f32")),
    (INIT("fast_math=False, default_ip=ti.i64"), "", CHANGED("default_ip=ti.i64", "default_ip=ti.i32")),
    ("runtime.start()", "'cuda'", SECOND),
    ("os.environ.update(TISCENE_ARCH='gpu')", "", ".*TISCENE_ARCH='gpu': must be one of cpu, cuda.*"),
    (NO_GPU("TISCENE_ARCH='cuda'"), "", MISSING),
    (NO_GPU(""), "'cuda'", MISSING),
]
CAUGHT = """
import json, os, sys
import taichi as ti
from tiscene.device import runtime
from tiscene.errors import TisceneError
for before, arguments, _ in json.loads(sys.argv[1]):
    if os.fork():
        os.wait()
        continue
    try:
        exec(before)
        eval(f"runtime.start({arguments})")
    except TisceneError as error:
        print(type(error).__name__, error, flush=True)
    os._exit(0)
"""


def test_start_is_silent_in_notebooks_too_and_happens_once():
    printed = run_python(
        "import os, sys\n"
        "os.dup2(1, 2)\n"
        "sys.stdout = open(1, 'w', closefd=False)\n"  # a notebook has an output of its own
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


def test_running_taichi_is_used_as_it_is():
    printed = run_python(
        "import taichi as ti\n"
        "ti.init(arch=ti.cpu, fast_math=False, log_level=ti.ERROR, cpu_max_num_threads=1)\n"
        "values = ti.ndarray(ti.f32, 3)\n"
        "values.fill(4.0)\n"
        "from tiscene.device import runtime\n"
        "print(runtime.start(), values.to_numpy().sum())"
    )
    assert printed.splitlines()[-1].endswith("cpu 12.0")


def test_start_that_does_not_fit_what_runs_or_the_machine_is_refused():
    lines = [line for line in run_python(CAUGHT, json.dumps(REFUSED)).splitlines() if "Error" in line]
    for (_, _, expected), line in zip(REFUSED, lines, strict=True):
        assert re.fullmatch(expected, line)


def test_unknown_architecture_is_refused():
    with pytest.raises(ArgumentError, match="arch='gpu': must be one of cpu, cuda"):
        runtime.start("gpu")


def test_stream_in_a_fork_raises_instead_of_waiting_for_ever():
    printed = run_python(
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


@pytest.mark.skipif(not fence.enabled(), reason="Taichi itself compiles without a lock")
def test_array_is_made_after_another_thread_has_compiled(monkeypatch):
    """Taichi keeps the state of its front end in globals: an array made in between fails, or breaks the kernel."""
    begun, order, materialize = threading.Event(), [], ast_recorder.materialize

    @ti.kernel
    def three() -> ti.i32:
        return 3

    def slowly(*arguments):
        begun.set()
        made.join(0.2)
        materialize(*arguments)
        order.append("compiled")

    def make():
        begun.wait(10.0)
        memory.device_array(ti.f32, 4)
        order.append("made")

    monkeypatch.setattr(ast_recorder, "materialize", slowly)
    made = threading.Thread(target=make)
    made.start()
    assert three() == 3
    made.join()
    assert order == ["compiled", "made"]
