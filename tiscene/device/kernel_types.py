# SPDX-License-Identifier: Apache-2.0
"""Types of kernel arguments. Taichi needs the values at run time; mypy sees `Any`.

Arrays are named by element type and number of axes: `Floats2` is a two-dimensional float32 array,
`Float8s1` a one-dimensional array of 8-vectors, `Floats` a float32 array of any number of axes.
"""

from typing import TYPE_CHECKING, Any, TypeAlias

import taichi as ti

if TYPE_CHECKING:
    Bytes2: TypeAlias = Any
    Bytes3: TypeAlias = Any
    Doubles1: TypeAlias = Any
    Doubles2: TypeAlias = Any
    Floats1: TypeAlias = Any
    Floats2: TypeAlias = Any
    Floats3: TypeAlias = Any
    Ints3: TypeAlias = Any
    Floats4: TypeAlias = Any
    Ints1: TypeAlias = Any
    Ints2: TypeAlias = Any
    u32: TypeAlias = Any
    vec2: TypeAlias = Any
    vec3: TypeAlias = Any
    vec4: TypeAlias = Any
    float4: TypeAlias = Any
    float8: TypeAlias = Any
    int8: TypeAlias = Any
    uint3: TypeAlias = Any
    Float4s1: TypeAlias = Any
    Float8s1: TypeAlias = Any
    Template: TypeAlias = Any
else:
    Bytes2 = ti.types.ndarray(ti.u8, 2)
    Bytes3 = ti.types.ndarray(ti.u8, 3)
    Doubles1 = ti.types.ndarray(ti.f64, 1)
    Doubles2 = ti.types.ndarray(ti.f64, 2)
    Floats1 = ti.types.ndarray(ti.f32, 1)
    Floats2 = ti.types.ndarray(ti.f32, 2)
    Floats3 = ti.types.ndarray(ti.f32, 3)
    Ints3 = ti.types.ndarray(ti.i32, 3)
    Floats4 = ti.types.ndarray(ti.f32, 4)
    Ints1 = ti.types.ndarray(ti.i32, 1)
    Ints2 = ti.types.ndarray(ti.i32, 2)
    u32 = ti.u32
    vec2 = ti.math.vec2
    vec3 = ti.math.vec3
    vec4 = ti.math.vec4
    float4 = ti.types.vector(4, ti.f32)
    float8 = ti.types.vector(8, ti.f32)
    int8 = ti.types.vector(8, ti.i32)
    uint3 = ti.types.vector(3, ti.u32)
    Float4s1 = ti.types.ndarray(float4, 1)
    Float8s1 = ti.types.ndarray(float8, 1)
    Template = ti.template()
