# SPDX-License-Identifier: Apache-2.0
"""Copies between NumPy and Taichi arrays keep all values, for every element type and layout."""

import numpy as np
import pytest
import taichi as ti


def new(shape: tuple[int, ...], kind: str):
    vec3, mat = ti.types.vector(3, ti.f32), ti.types.matrix(2, 3, ti.f32)
    return ti.ndarray({"f32": ti.f32, "i32": ti.i32, "u8": ti.u8, "f64": ti.f64, "vec3": vec3, "mat": mat}[kind], shape)


@ti.kernel
def total(values: ti.types.ndarray(ti.types.vector(3, ti.f32), 2)) -> ti.f32:
    result = 0.0
    ti.loop_config(serialize=True)
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            result += values[i, j].dot(ti.math.vec3(1.0, 10.0, 100.0)) * (i + 1)
    return result


@pytest.mark.parametrize("kind", ["f32", "i32", "u8", "f64", "vec3", "mat"])
def test_to_numpy_returns_what_from_numpy_was_given(kind):
    array = new((4, 5), kind)
    inner = {"vec3": (3,), "mat": (2, 3)}.get(kind, ())
    values = np.arange(20 * int(np.prod(inner))).reshape(4, 5, *inner)
    array.from_numpy(values.astype(np.int16))  # converts, as Taichi's kernel does
    found = array.to_numpy()
    assert (found == values).all()
    assert found.dtype == {"i32": np.int32, "u8": np.uint8, "f64": np.float64}.get(kind, np.float32)
    found[...] = 0
    assert (array.to_numpy() == values).all(), "to_numpy returns a copy"
    array.from_numpy(np.asfortranarray(values)[::-1])
    assert (array.to_numpy() == values[::-1]).all()
    array.fill(7)
    assert (array.to_numpy() == 7).all()


def test_kernel_reads_what_was_copied():
    array = new((2, 1), "vec3")
    array.from_numpy(np.array([[[1, 2, 3]], [[4, 5, 6]]], np.float32))
    assert total(array) == 321 + 2 * 654
    assert array[1, 0].y == 5


def test_wrong_shape_or_type_is_refused():
    array = new((4, 5), "vec3")
    with pytest.raises(ValueError, match=r"Mismatch shape: \(4, 5, 3\) expected, but \(4, 5\) provided"):
        array.from_numpy(np.zeros((4, 5), np.float32))
    with pytest.raises(TypeError, match="ndarray"):
        array.from_numpy([1.0])
