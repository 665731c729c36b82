# SPDX-License-Identifier: Apache-2.0
"""Vectors and colors in three columns of a row of a table."""

import taichi as ti

from tiscene.device.kernel_types import Template, vec3


@ti.func
def read3(array: Template, row: ti.i32, column: ti.i32) -> vec3:
    """Read three columns of a row."""
    return vec3(array[row, column], array[row, column + 1], array[row, column + 2])


@ti.func
def write3(array: Template, row: ti.i32, column: ti.i32, v: vec3):
    """Write a vector to three columns of a row."""
    for c in ti.static(range(3)):
        array[row, column + c] = v[c]
