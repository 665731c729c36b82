# SPDX-License-Identifier: Apache-2.0
"""Launches of kernels without most of what Taichi does in Python for each: 0.06 ms in the place of 0.2 to 0.3 ms.

Taichi 1.7.4 looks at all types of all arguments twice, asks each for what only a few kinds need, and sets all of them.
Here a kernel that was called once is launched at once for further arguments of its types, and on a CPU only those are
set that are not the last launch's. Whatever is not plainly so (another type, a result that is no integer, a tape of
derivatives) takes Taichi's own way, errors included.
"""

from __future__ import annotations

import weakref
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import taichi as ti
from taichi.lang import kernel_impl
from taichi.lang._ndarray import ScalarNdarray
from taichi.lang.matrix import MatrixType, VectorNdarray
from taichi.lang.util import to_numpy_type
from taichi.types import primitive_types
from taichi.types.annotations import template
from taichi.types.ndarray_type import NdarrayType

ARRAY, VECTORS, OPEN, INTEGER, REAL = range(5)  # OPEN: arrays of any type
_LARGE = 1 << 31  # bytes from which Taichi looks whether an index may be too large
_PLAIN = (bool, int, float, str, type(None))  # of template arguments: those that are what they are equal to

_own_way: Any = kernel_impl.Kernel.__call__


@dataclass(eq=False)
class _Compiled:
    """A kernel for certain values of its templates and types of open arrays. contexts: arguments that were set for
    earlier launches and are not in use, with what each slot had last: a number, a weak reference to an array, else
    None."""

    kernel: Any
    code: Any
    contexts: list[tuple[Any, list[Any]]] = field(default_factory=list)


@dataclass(eq=False)
class _Plan:
    """How a kernel takes its arguments. parameters: (slot, kind, Taichi's type, numpy's type, length of a vector, axes)
    of each that is no template. templates: rows of the others. open: rows of arrays of any type. compiled: by the
    values of the ones and the types of the others."""

    runtime: Any
    keeps: bool  # what was set for one launch is there for the next: so on CPUs
    counts: bool  # the result is an integer; else there is none
    parameters: list[tuple[Any, ...]] = field(default_factory=list)
    templates: list[int] = field(default_factory=list)
    open: list[int] = field(default_factory=list)
    compiled: dict[tuple[Any, ...], _Compiled] = field(default_factory=dict)


_plans: dict[Any, _Plan | None] = {}  # by kernel; None: not for here


def use() -> None:
    """Launch all kernels of this process so."""
    kernel_impl.Kernel.__call__ = _call


def _call(kernel: Any, *args: Any, **kwargs: Any) -> Any:
    runtime = kernel.runtime
    plan = _plans.get(kernel)
    if kernel not in _plans or (plan is not None and plan.runtime is not runtime):
        plan = _plans[kernel] = _plan(kernel)
    if plan is None or kwargs or len(args) != len(kernel.arguments) or runtime.target_tape or runtime.fwd_mode_manager:
        return _own_way(kernel, *args, **kwargs)
    values: tuple[Any, ...] = args
    key: tuple[Any, ...] = ()
    if plan.templates:
        key = tuple([args[row] for row in plan.templates])
        if not all(type(each) in _PLAIN for each in key):
            return _own_way(kernel, *args)
        values = tuple([value for row, value in enumerate(args) if row not in plan.templates])
    if plan.open:
        key += tuple([_type_of(args[row]) for row in plan.open])
    compiled = plan.compiled.get(key)
    if compiled is None:
        result = _own_way(kernel, *args)
        if kernel.has_print:
            _plans[kernel] = None
        else:
            made, program = kernel.compiled_kernels[kernel.ensure_compiled(*args)], runtime.prog
            code = program.compile_kernel(program.config(), program.get_device_caps(), made)
            plan.compiled[key] = _Compiled(made, code)
        return result
    if compiled.contexts:
        context, last = compiled.contexts.pop()
    else:
        context, last = compiled.kernel.make_launch_context(), [None] * len(values)
    if not _set(context, last, values, plan, runtime.prog):
        return _own_way(kernel, *args)
    try:
        runtime.prog.launch_kernel(compiled.code, context)
    except Exception as error:
        raise kernel_impl.handle_exception_from_cpp(error) from None
    result = None
    if plan.counts:
        runtime.sync()
        result = context.get_struct_ret_int((0,))
    if plan.keeps:
        compiled.contexts.append((context, last))
    return result


def _set(context: Any, last: list[Any], values: tuple[Any, ...], plan: _Plan, program: Any) -> bool:
    """Set the arguments that are not the last ones; False where one is not of the type that it has to be."""
    for row, (value, before, parameter) in enumerate(zip(values, last, plan.parameters, strict=True)):
        slot, kind, dtype, numpy_dtype, length, axes = parameter
        given = type(value)
        if kind <= OPEN:
            if before is not None and before() is value:
                continue
            if given is np.ndarray:
                fits = kind == OPEN or (kind == ARRAY and value.dtype is numpy_dtype and value.ndim == axes)
                if not (fits and value.flags.c_contiguous and value.nbytes < _LARGE):
                    return False
                context.set_arg_external_array_with_shape(slot, value.ctypes.data, value.nbytes, value.shape, 0)
                last[row] = None
                continue
            if kind == ARRAY:
                fits = given is ScalarNdarray and value.element_type is dtype and len(value.shape) == axes
            elif kind == VECTORS:
                fits = given is VectorNdarray and value.dtype is dtype and value.n == length
                fits = fits and len(value.shape) == axes
            else:
                fits = given is ScalarNdarray or given is VectorNdarray
            if not fits or value.grad is not None:
                return False
            if plan.keeps:
                address, size = program.get_ndarray_data_ptr_as_int(value.arr), _size(value.arr)
                context.set_arg_external_array_with_shape(slot, address, size, value.shape, 0)
                last[row] = weakref.ref(value)
            else:
                context.set_arg_ndarray(slot, value.arr)
        elif kind == INTEGER:
            if given is not int:
                return False
            if before is not value:
                context.set_arg_int(slot, value)
                last[row] = value
        else:
            if given is not float and given is not int:
                return False
            if before is not value:
                context.set_arg_float(slot, float(value))
                last[row] = value
    return True


def _type_of(value: Any) -> tuple[Any, ...]:
    """Of an array: what Taichi compiles a kernel for."""
    dtype = getattr(value, "dtype", None)
    return type(value), dtype, getattr(value, "n", None), len(getattr(value, "shape", ()))


def _size(array: Any) -> int:
    """In bytes; not 0, which would mean that there is no array."""
    return max(int(array.nelement() * array.element_size()), 1)


def _plan(kernel: Any) -> _Plan | None:
    """None for what is left to Taichi."""
    integers = (primitive_types.i32,), (primitive_types.i64,)
    counts = kernel.return_type is not None and tuple(kernel.return_type) in integers
    if kernel.classkernel or kernel.autodiff_mode != kernel_impl.AutodiffMode.NONE:
        return None
    if kernel.return_type is not None and not counts:
        return None
    plan = _Plan(kernel.runtime, ti.cfg.arch in (ti.x64, ti.arm64), counts)
    for row, argument in enumerate(kernel.arguments):
        wanted, slot = argument.annotation, (len(plan.parameters),)
        if isinstance(wanted, template):
            plan.templates.append(row)
        elif isinstance(wanted, NdarrayType) and wanted.dtype is None and wanted.ndim is None:
            plan.open.append(row)
            plan.parameters.append((slot, OPEN, None, None, 0, 0))
        elif isinstance(wanted, NdarrayType) and wanted.dtype is not None and wanted.ndim is not None:
            dtype, axes = wanted.dtype, wanted.ndim
            if not isinstance(dtype, MatrixType):
                plan.parameters.append((slot, ARRAY, dtype, np.dtype(to_numpy_type(dtype)), 0, axes))
            elif dtype.ndim == 1:
                plan.parameters.append((slot, VECTORS, dtype.dtype, None, dtype.n, axes))
            else:
                return None
        elif wanted is primitive_types.i32:
            plan.parameters.append((slot, INTEGER, wanted, None, 0, 0))
        elif wanted is primitive_types.f32 or wanted is primitive_types.f64:
            plan.parameters.append((slot, REAL, wanted, None, 0, 0))
        else:
            return None
    return plan
