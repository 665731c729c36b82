# SPDX-License-Identifier: Apache-2.0
"""Kernels with simplified calls return what Taichi's own do, and have fewer variables."""

from collections import Counter

import numpy as np
import pytest
import taichi as ti

from tiscene.device.taichi_patches import ast_recorder
from tiscene.device.taichi_patches.recording_file import read_recording

vec3 = ti.types.vector(3, ti.f32)
values1 = ti.types.ndarray(ti.f32, 1)


@ti.func
def doubled(x):
    return x + x


@ti.func
def copied(x: ti.f32) -> ti.f32:
    y = x
    return y


@ti.func
def shifted(x, v: vec3):
    y, w = x, v
    y += 1.0
    w[1] = y
    w.xz = w.zx
    return y, w


@ti.func
def write(target: ti.template(), x):
    target = x  # noqa: F841  (a template is the caller's variable)


def copies(values: values1):
    for _ in range(1):
        a = values[0]
        b = a
        a = 5.0
        values[1] = copied(doubled(copied(b))) + a
        values[2] = doubled(doubled(2.0)) + copied(3.0)


def changed_copies(values: values1):
    for _ in range(1):
        x, v = values[0], vec3(values[1], values[2], values[3])
        y, w = shifted(x, v)
        values[4] = x + 10.0 * y
        for k in ti.static(range(3)):
            values[k] = v[k] + 100.0 * w[k]
        z = copied(y)
        write(y, 7.0)
        values[5] = y + 10.0 * z


def atomics(values: values1):
    for _ in range(1):
        x = values[1]
        before = copied(x)
        old = ti.atomic_add(x, 2.0)
        total = x
        total -= 0.5
        values[0] = before + 10.0 * old + 100.0 * x + 1000.0 * total


def loops(values: values1):
    for i in range(values.shape[0]):
        last, current, count = 0.0, 1.0, 0
        while count < i + 3:
            following = copied(last) + current
            last = current
            current = copied(following)
            count += 1
            for k in range(count):
                index = k
                offset = doubled(index)
                index += offset
                current += index
        values[i] = last + 1000.0 * current


def branches(values: values1):
    for i in range(values.shape[0]):
        first = copied(values[i])
        second = first
        if first > 2:
            second = copied(first) * 3
        chosen = ti.select(second > first, second, 0)
        values[i] = chosen if chosen > 0 or values[0] > 1 else first / 3


def constants(values: values1):
    for _ in range(1):
        big, step = ti.u32(4000000000), ti.u32(3)
        largest = 2147483647
        values[0] = ti.cast((big + step * 100000000) % 1000, ti.f32)  # wraps
        values[1] = ti.cast(largest + 2, ti.f32)  # wraps
        values[2] = values[2] * 16777217 + ti.cast(16777219, ti.f32)
        values[3] = ti.cast(big & 255, ti.f32) + ti.cast(step == -1, ti.f32)
        values[4] = ti.cast(ti.cast(-1, ti.u32) >> 28, ti.f32)
        values[5] = ti.max(values[5], 3) - ti.min(2, values[4]) / 4
        values[1 + 2 * 2] += 7 - 2


def large_products(values: values1):
    for _ in range(1):
        unsigned, signed = ti.u32(4000000001), 2000000011
        values[0] = ti.cast((unsigned * unsigned) & 65535, ti.f32)  # more than 64 bits with a sign hold
        values[1] = ti.cast((signed * signed) & 65535, ti.f32)
        values[2] = ti.cast(signed * -signed, ti.f32)


def order(values: values1):
    for _ in range(1):
        x = values[0]
        old = x
        y = ti.atomic_add(x, 2.0) + old  # `old` is read before x changes
        z = ti.atomic_add(x, 1.0)
        w = x + z  # x is read afterwards
        element = values[1]
        values[1] = element + y
        v = vec3(w, y, z)
        values[2] = v[1]
        large = values[3] * 1e30
        found = values[4] > 100.0 and large > 1.0
        values[3] = 1.0 if found else w
        row = values.shape[0] - 1
        values[row] = old + 10.0 * z


FUNCTIONS = [copies, changed_copies, atomics, loops, branches, constants, large_products, order]


def result(function):
    values = ti.ndarray(ti.f32, 6)
    values.from_numpy(np.array([0.1, 1.7, 2.3, -3.9, 4.1, 5.3], np.float32))
    ti.kernel(function)(values)  # a new kernel each time
    return values.to_numpy().tolist()


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda function: function.__name__)
def test_results_are_those_of_taichi_s_own_kernel(function, folder, monkeypatch):
    simplified = result(function)
    assert len(list(folder.glob("*.calls"))) == 1
    monkeypatch.setattr(ast_recorder, "_fingerprint_of", lambda *args: None)
    assert simplified == result(function)


def recorded(function, folder):
    """Return the number of calls of each name."""
    before = set(folder.glob("*.calls"))
    result(function)
    (file,) = set(folder.glob("*.calls")) - before
    return Counter(read_recording(file).calls)


def by_hand(values: values1):
    """Make what `copies` does without functions."""
    for _ in range(1):
        a = values[0]
        b = a
        a = 5.0
        c = b + b
        values[1] = c + a
        two = 2.0
        d = two + two
        values[2] = d + d + 3.0


def test_functions_cost_no_variables(folder):
    assert recorded(copies, folder) == recorded(by_hand, folder)


def test_values_that_the_next_statement_reads_need_no_variable(folder):
    calls = recorded(order, folder)
    # x, old, the results of two atomic additions, y, w, v, large, found
    assert calls["ASTBuilder.expr_var"] == 9


def test_integers_are_computed_and_cast_beforehand(folder):
    calls = recorded(constants, folder)
    assert calls["expr_add"] == 2  # values[2] and values[3]
    assert calls["expr_mul"] == 2  # values[2], and of the remainder
    assert calls["value_cast"] == 4  # of values that are known in the kernel only
