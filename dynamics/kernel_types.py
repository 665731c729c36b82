# SPDX-License-Identifier: Apache-2.0
"""Types of kernel arguments: Taichi annotations at run time, `Any` for mypy.

Arrays are named by element type and number of dimensions: `Floats2` is a two-dimensional float32 array.
"""

from typing import TYPE_CHECKING, Any, TypeAlias

import taichi as ti

if TYPE_CHECKING:
    Doubles1: TypeAlias = Any
    Doubles2: TypeAlias = Any
    Floats1: TypeAlias = Any
    Floats2: TypeAlias = Any
    Ints1: TypeAlias = Any
    Ints2: TypeAlias = Any
    Template: TypeAlias = Any
else:
    Doubles1 = ti.types.ndarray(ti.f64, 1)
    Doubles2 = ti.types.ndarray(ti.f64, 2)
    Floats1 = ti.types.ndarray(ti.f32, 1)
    Floats2 = ti.types.ndarray(ti.f32, 2)
    Ints1 = ti.types.ndarray(ti.i32, 1)
    Ints2 = ti.types.ndarray(ti.i32, 2)
    Template = ti.template()
