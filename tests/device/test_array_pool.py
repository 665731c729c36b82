# SPDX-License-Identifier: Apache-2.0
"""Freed arrays: small memory is used again, as zeros; what is kept is bounded, and forgotten at a restart of Taichi."""

import _thread
import gc
from operator import call

import pytest
import taichi as ti
from taichi.lang import _ndarray, impl, matrix

import tiscene as ts
from tests.device.programs import run_python
from tiscene.device import array_pool, runtime
from tiscene.device.memory import device_array

VECTOR = ti.types.vector(3, ti.f32)
TEMPLATES = ("Cube", "Sphere", "Ball 01")


@pytest.fixture(autouse=True)
def started():
    if runtime.start() != "cpu":
        pytest.skip("only on CPUs")
    gc.collect()


@pytest.fixture
def made(monkeypatch):
    """The kind of each array for which Taichi allocates memory, a list."""
    allocated = []
    take = array_pool.POOL.take
    monkeypatch.setattr(array_pool.POOL, "take", lambda key: take(key) or allocated.append(key))
    return allocated


@pytest.mark.parametrize("dtype", [ti.f32, ti.i32, ti.u8, VECTOR], ids=("f32", "i32", "u8", "vector"))
def test_array_in_the_memory_of_a_deleted_one_is_zero(dtype, made):
    array = device_array(dtype, (13, 7))
    array.fill(5)
    memory = array.arr
    del array
    gc.collect()  # Taichi keeps arguments of its own kernels in cycles
    del made[:]
    again = device_array(dtype, (13, 7))
    assert again.arr is memory
    assert not made
    assert again.shape == (13, 7)
    assert not again.to_numpy().any()


def test_list_that_an_interruption_has_left_empty_is_passed_over():
    pool = array_pool.ArrayPool()
    pool.take("key")
    pool._kept["key"] = []
    assert pool.take("key") is None
    pool._nbytes = array_pool.MAX_KEPT + 1
    assert pool.take("other") is None


@pytest.mark.parametrize("step", ["__init__", "get_traceback"])
@pytest.mark.parametrize("dtype", [ti.f32, VECTOR], ids=("f32", "vector"))
def test_ctrl_c_while_an_array_is_made_leaves_nothing_to_complain_of(dtype, step, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    if step == "__init__":
        monkeypatch.setattr(_ndarray.Ndarray, "__init__", interrupted)
    else:
        monkeypatch.setattr(_ndarray, "get_traceback", interrupted)
        monkeypatch.setattr(matrix, "get_traceback", interrupted)
    with pytest.raises(KeyboardInterrupt):
        device_array(dtype, (3, 5))
    gc.collect()  # pytest turns an exception in __del__ into an error


@pytest.mark.parametrize("size", [15, array_pool.MAX_ARRAY], ids=("small", "large"))
@pytest.mark.parametrize("dtype", [ti.f32, VECTOR], ids=("f32", "vector"))
def test_ctrl_c_just_before_an_array_is_deleted_is_not_lost(dtype, size):
    arrays = [device_array(dtype, size)]
    with pytest.raises(KeyboardInterrupt):
        list(map(call, [_thread.interrupt_main, arrays.clear]))  # both before Python looks for signals
    assert not arrays


def test_memory_is_not_shared_by_living_arrays_nor_used_for_other_types():
    arrays = [device_array(dtype, 19) for dtype in (ti.f32, ti.i32, VECTOR) for _ in range(2)]
    program = impl.get_runtime().prog
    for _ in range(2):
        assert len({program.get_ndarray_data_ptr_as_int(each.arr) for each in arrays}) == 6
        kinds = [(each.dtype, each.element_shape) for each in arrays]
        del arrays
        arrays = [device_array(dtype, 19) for dtype in (ti.f32, ti.i32, VECTOR) for _ in range(2)]
        assert [(each.dtype, each.element_shape) for each in arrays] == kinds


def test_what_is_kept_is_bounded_and_large_arrays_are_freed():
    kept = array_pool.POOL.nbytes
    device_array(ti.f32, array_pool.MAX_ARRAY // 4 + 1)
    assert array_pool.POOL.nbytes == kept
    arrays = [device_array(ti.f32, (2, 8000 + i)) for i in range(array_pool.MAX_KEPT // 64000 + 10)]
    arrays.clear()
    assert 0.9 * array_pool.MAX_KEPT < array_pool.POOL.nbytes <= array_pool.MAX_KEPT


def test_restart_of_taichi_forgets_the_memory():
    code = """
import taichi as ti
from tiscene.device import runtime
from tiscene.device.array_pool import POOL
from tiscene.device.memory import device_array
runtime.start("cpu")
alive = device_array(ti.f32, 11)
device_array(ti.f32, 11), device_array(ti.types.vector(2, ti.f32), 5)
kept = POOL.nbytes
ti.init(ti.cpu, fast_math=False, log_level=ti.ERROR)
runtime.start("cpu")
arrays = [device_array(ti.f32, 11) for _ in range(3)]
del alive
for each in arrays:
    each.fill(1.0)
print(kept, POOL.nbytes, sum(each.to_numpy().sum() for each in arrays))
"""
    assert run_python(code).splitlines()[-1].split() == ["84", "0", "33.0"]


def test_restarts_of_a_stream_make_no_memory_after_the_first_rounds(made):
    stream = ts.Stream("object_view", buffers=("instance", "depth"), width=32, height=24)

    def restart(step):
        objects = [ts.Object("object", TEMPLATES[step % 3], (0.3, 0.1, 0.2))]
        stream.restart(ts.Scenario("object_view", objects))
        next(stream)

    for step in range(6):
        restart(step)
    del made[:]
    for step in range(6):
        restart(step)
    assert not made


def test_arrays_that_live_until_python_ends_are_silent():
    code = """
import os
import sys
import taichi as ti
from tiscene.device import runtime
from tiscene.device.memory import device_array
runtime.start()
sys.kept_to_the_end = device_array(ti.f32, (8,))
os.dup2(1, 2)
"""
    lines = run_python(code).splitlines()
    assert [line for line in lines if not line.startswith("[Taichi]")] == []
