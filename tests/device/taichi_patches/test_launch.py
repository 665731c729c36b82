# SPDX-License-Identifier: Apache-2.0
"""Kernels launched directly have the results and the errors of Taichi's own launches."""

import _thread
import gc
import weakref
from operator import call

import numpy as np
import pytest
import taichi as ti
from taichi.lang.kernel_impl import Kernel

from tiscene.device.memory import upload

vec4 = ti.types.vector(4, ti.f32)
FLOATS = ti.types.ndarray(ti.f32, 2)
VECTORS = ti.types.ndarray(vec4, 1)


@ti.kernel
def scale(source: FLOATS, count: ti.i32, factor: ti.f32, result: FLOATS):
    for i in range(count):
        for j in range(source.shape[1]):
            result[i, j] = factor * source[i, j]


@ti.kernel
def shift(vectors: VECTORS, up: ti.template(), by: ti.f64, large: ti.u8):
    for i in range(vectors.shape[0]):
        for c in ti.static(range(4)):
            vectors[i][c] += ti.cast(by, ti.f32) if ti.static(up) else -ti.cast(by, ti.f32)


@ti.kernel
def turn(vectors: VECTORS, up: ti.template(), by: ti.f64):
    for i in range(vectors.shape[0]):
        for c in ti.static(range(4)):
            vectors[i][c] += ti.cast(by, ti.f32) if ti.static(up) else -ti.cast(by, ti.f32)


@ti.kernel
def copy(source: ti.types.ndarray(), result: ti.types.ndarray()):
    for i in range(source.shape[0]):
        result[i] = source[i]


@ti.kernel
def total(values: FLOATS) -> ti.f32:
    result = 0.0
    for i in range(values.shape[0]):
        result += values[i, 0]
    return result


@ti.kernel
def above(values: FLOATS, limit: ti.f32) -> ti.i32:
    count = 0
    for i in range(values.shape[0]):
        if values[i, 0] > limit:
            count += 1
    return count - 2


def device_array(values):
    array = ti.ndarray(ti.f32, values.shape)
    array.from_numpy(values)
    return array


def test_results_are_right_for_changing_numpy_and_taichi_arrays():
    rng = np.random.default_rng(0)
    kept = rng.random((5, 3)).astype(np.float32)
    on_device = device_array(kept)
    for turn_number in range(6):
        fresh = rng.random((4 + turn_number, 3)).astype(np.float32)
        for source, values in ((fresh, fresh), (on_device, kept), (device_array(fresh), fresh), (on_device, kept)):
            result = np.zeros((len(values), 3), np.float32)
            count = len(values) - turn_number % 2
            scale(source, count, 0.5 + turn_number, result)
            assert np.array_equal(result[:count], values[:count] * np.float32(0.5 + turn_number))
            assert not result[count:].any()
        gc.collect()  # a later array may lie at the address of a deleted one


def test_result_is_written_for_any_order_of_launches():
    a, b = (ti.ndarray(ti.f32, (2, 2)) for _ in range(2))
    ones = np.ones((2, 2), np.float32)
    for number in range(1, 4):
        scale(ones, 2, float(number), a)
        scale(a, 2, 10, b)  # an int as a float
        scale(b, 2, 1.0, a)
        assert np.array_equal(a.to_numpy(), 10 * number * ones)


def test_vector_arrays_and_template_arguments():
    vectors = ti.ndarray(vec4, 3)
    for up, by in ((True, 3.0), (False, 1.0), (True, 0.5), (False, 2.5)):
        before = vectors.to_numpy()
        turn(vectors, up, by)
        assert np.array_equal(vectors.to_numpy(), before + (by if up else -by))


def test_untyped_arrays_take_any_element_type():
    for _ in range(3):
        for dtype, other in ((np.float32, np.float64), (np.int32, np.uint8), (np.float64, np.float32)):
            values, result = np.arange(5).astype(dtype), np.zeros(5, other)
            copy(values, result)
            assert np.array_equal(result, values)
        vectors, result = ti.ndarray(vec4, 3), ti.ndarray(vec4, 3)
        vectors.from_numpy(np.arange(12, dtype=np.float32).reshape(3, 4))
        copy(vectors, result)
        assert np.array_equal(result.to_numpy(), vectors.to_numpy())
        ints = ti.ndarray(ti.i32, 3)
        copy(np.arange(3, dtype=np.int32), ints)
        assert ints.to_numpy().tolist() == [0, 1, 2]


def test_integer_results_are_returned():
    values = np.arange(10, dtype=np.float32).reshape(10, 1)
    on_device = device_array(values)
    for limit in (3.0, -1.0, 20.0, 3.0):
        expected = int((values > limit).sum()) - 2
        assert above(values, limit) == above(on_device, limit) == expected
    assert above._primal.launch_plan.returns_integer


def test_unsupported_arguments_take_taichi_s_own_way():
    values = np.arange(6, dtype=np.float32).reshape(3, 2)
    for _ in range(3):
        result = np.zeros((3, 2), np.float32)
        scale(np.asfortranarray(values), np.int32(3), np.float32(2.0), result)
        assert np.array_equal(result, 2.0 * values)
        scale(values, 3, factor=3.0, result=result)
        assert np.array_equal(result, 3.0 * values)
        assert total(values) == 6.0
        vectors = ti.ndarray(vec4, 2)
        shift(vectors, True, 1.0, 7)
        assert (vectors.to_numpy() == 1.0).all()
        as_numpy = np.zeros((2, 4), np.float32)
        turn(as_numpy, True, 1.0)
        assert (as_numpy == 1.0).all()


@pytest.mark.parametrize(
    "arguments",
    [
        (np.zeros((2, 2)), 2, 1.0, np.zeros((2, 2), np.float32)),
        (np.zeros(2, np.float32), 2, 1.0, np.zeros((2, 2), np.float32)),
        (np.zeros((2, 2), np.float32), 2.5, 1.0, np.zeros((2, 2), np.float32)),
        (np.zeros((2, 2), np.float32), 2, "x", np.zeros((2, 2), np.float32)),
        (None, 2, 1.0, np.zeros((2, 2), np.float32)),
        (np.zeros((2, 2), np.float32), 2, 1.0),
    ],
)
def test_wrong_argument_raises_what_taichi_raises(arguments):
    right = np.ones((2, 2), np.float32)
    scale(right, 2, 1.0, right)
    with pytest.raises(Exception) as own:  # noqa: PT011 - whatever Taichi raises
        Kernel.__call__(scale._primal, *arguments)
    with pytest.raises(own.type):
        scale(*arguments)
    scale(right, 2, 3.0, right)
    assert (right == 3.0).all()


def test_taichi_array_of_wrong_type_is_refused():
    right = np.ones((2, 2), np.float32)
    scale(right, 2, 1.0, right)
    for wrong in (ti.ndarray(ti.i32, (2, 2)), ti.ndarray(ti.f32, 4), ti.ndarray(vec4, 2)):
        with pytest.raises((TypeError, ValueError)):
            scale(wrong, 2, 1.0, right)


def test_ctrl_c_just_before_an_array_is_deleted_leaves_no_address_of_it():
    result = np.zeros((1, 1), np.float32)
    for value in range(1, 50):
        arrays = [upload(np.full((1 + value % 2, 1), value, np.float32))]  # at the address of the one before
        scale(arrays[0], 1, 1.0, result)
        assert result == value
        with pytest.raises(KeyboardInterrupt):
            list(map(call, [_thread.interrupt_main, arrays.clear]))  # both before Python looks for signals


def test_launch_keeps_no_array_alive():
    result = np.zeros((1, 1), np.float32)
    alive = []
    for _ in range(3):
        array = device_array(np.ones((1, 1), np.float32))
        scale(array, 1, 1.0, result)
        alive.append(weakref.ref(array))
        del array
        gc.collect()
    assert [each() for each in alive] == [None] * 3
