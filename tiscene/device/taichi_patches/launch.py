# SPDX-License-Identifier: Apache-2.0
"""Launch compiled kernels with less Python: 0.06 ms a launch instead of 0.2 to 0.3 ms.

Taichi 1.7.4 inspects the types of all arguments twice at each launch, and sets all of them. Here a kernel that was
called once is launched directly for further arguments of the same types, and on a CPU only the arguments are set that
differ from those of the last launch. Every other case (another type, a result that is not an integer, automatic
differentiation) takes Taichi's own way, errors included.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from operator import is_, itemgetter, setitem
from typing import Any

import numpy as np
import taichi as ti
from taichi.lang import kernel_impl
from taichi.lang._ndarray import ScalarNdarray
from taichi.lang.kernel_impl import Kernel
from taichi.lang.matrix import MatrixType, VectorNdarray
from taichi.lang.util import to_numpy_type
from taichi.types import primitive_types
from taichi.types.annotations import template
from taichi.types.ndarray_type import NdarrayType

from tiscene.device import restart

# Kinds of parameters. UNTYPED: an array of any element type and number of axes.
SCALAR_ARRAY, VECTOR_ARRAY, UNTYPED, INTEGER, REAL = range(5)

_MAX_BYTES = 1 << 31  # from here on Taichi checks whether indices fit 32 bits
_VALUE_TYPES = frozenset({bool, int, float, str, type(None)})  # template arguments that are compared by value


@dataclass(eq=False, slots=True)
class LaunchArguments:
    """The arguments of one launch, which the next one may share.

    Attributes:
        context: Taichi's launch context.
        array_ids: `id` of each array that is set and exists; else: set it again.
        references: Weak references to these arrays, which take the places of their ids when they are deleted.
        numbers: The numbers that are set.
    """

    context: Any
    array_ids: list[Any]
    references: list[Any]
    numbers: list[Any]

    def keep_array(self, row: int, array: Any) -> None:
        """Note that an array is set."""
        # Functions of C: Ctrl-C would end one of Python, and leave an id that a later array may have.
        self.references[row] = weakref.ref(array, partial(setitem, self.array_ids, row))
        self.array_ids[row] = id(array)


@dataclass(eq=False)
class CompiledVariant:
    """A kernel compiled for one set of template values and types of untyped arrays.

    Attributes:
        kernel: Taichi's kernel.
        code: The compiled code.
        arguments: Arguments that no launch uses at the moment.
    """

    kernel: Any
    code: Any
    arguments: list[LaunchArguments] = field(default_factory=list)


def _nothing(_args: tuple[Any, ...]) -> tuple[Any, ...]:
    return ()


@dataclass(eq=False)
class LaunchPlan:
    """How the arguments of a kernel are set.

    Attributes:
        runtime: Taichi's runtime for which the plan was made.
        supported: Whether the kernel is launched here. False: Taichi launches it.
        keeps_arguments: Whether a launch context can be used again (on CPUs).
        returns_integer: Whether the kernel returns an integer; else it returns nothing.
        arrays: (slot, kind, Taichi's type, NumPy's dtype, vector length, axes) of each array.
        numbers: (slot, kind) of each number.
        arrays_of, numbers_of, templates_of, untyped_of: Select the arrays, the numbers, the template values and the
            untyped arrays from the arguments of a call.
        variants: Compiled variants, keyed by template values and the types of untyped arrays.
    """

    runtime: Any
    supported: bool = True
    keeps_arguments: bool = False
    returns_integer: bool = False
    arrays: list[tuple[Any, ...]] = field(default_factory=list)
    numbers: list[tuple[Any, ...]] = field(default_factory=list)
    arrays_of: Callable[[tuple[Any, ...]], tuple[Any, ...]] = _nothing
    numbers_of: Callable[[tuple[Any, ...]], tuple[Any, ...]] = _nothing
    templates_of: Callable[[tuple[Any, ...]], tuple[Any, ...]] = _nothing
    untyped_of: Callable[[tuple[Any, ...]], tuple[Any, ...]] = _nothing
    variants: dict[tuple[Any, ...], CompiledVariant] = field(default_factory=dict)

    def new_arguments(self, kernel: Any) -> LaunchArguments:
        """Return arguments of which none is set."""
        arrays, numbers = len(self.arrays), len(self.numbers)
        return LaunchArguments(kernel.make_launch_context(), [0] * arrays, [None] * arrays, [None] * numbers)


def launch(kernel: Any, *args: Any, **kwargs: Any) -> Any:
    """Call a kernel, as `Kernel.__call__` does. `kernel.launch_plan` is None before the first call."""
    runtime, plan = kernel.runtime, kernel.launch_plan
    if plan is None or plan.runtime is not runtime:
        plan = kernel.launch_plan = _plan(kernel)
    if (
        not plan.supported
        or kwargs
        or len(args) != len(kernel.arguments)
        or runtime.target_tape
        or runtime.fwd_mode_manager
    ):
        return _launch_by_taichi(kernel, args, kwargs)
    key = plan.templates_of(args)
    if not _VALUE_TYPES.issuperset(map(type, key)):
        return _launch_by_taichi(kernel, args)
    untyped = plan.untyped_of(args)
    if untyped:
        key += tuple(map(_type_of, untyped))
    variant = plan.variants.get(key)
    if variant is None:
        for value in args:
            restart.check_array(value)
        result = _launch_by_taichi(kernel, args)
        if kernel.has_print:
            plan.supported = False
        else:
            compiled, program = kernel.compiled_kernels[kernel.ensure_compiled(*args)], runtime.prog
            with _compile_options():
                code = program.compile_kernel(program.config(), program.get_device_caps(), compiled)
            plan.variants[key] = CompiledVariant(compiled, code)
        return result
    arguments = variant.arguments.pop() if variant.arguments else plan.new_arguments(variant.kernel)
    if not _set_arguments(arguments, args, plan, runtime.prog):
        return _launch_by_taichi(kernel, args)
    try:
        runtime.prog.launch_kernel(variant.code, arguments.context)
    except Exception as error:
        raise kernel_impl.handle_exception_from_cpp(error) from None
    result = None
    if plan.returns_integer:
        runtime.prog.synchronize()
        result = arguments.context.get_struct_ret_int((0,))
    if plan.keeps_arguments:
        variant.arguments.append(arguments)
    return result


def _launch_by_taichi(kernel: Any, args: tuple[Any, ...], kwargs: dict[str, Any] | None = None) -> Any:
    with _compile_options():
        return Kernel.__call__(kernel, *args, **(kwargs or {}))


@contextmanager
def _compile_options() -> Iterator[None]:
    """Compile as where tiscene started Taichi: without optimizations that LLVM repeats, 12 times as fast."""
    before = ti.cfg.advanced_optimization
    ti.cfg.advanced_optimization = False
    try:
        yield
    finally:
        ti.cfg.advanced_optimization = before


def _set_arguments(arguments: LaunchArguments, args: tuple[Any, ...], plan: LaunchPlan, program: Any) -> bool:
    """Set the arguments that differ from the last launch's; return False if one is not of the expected type."""
    arrays, numbers = plan.arrays_of(args), plan.numbers_of(args)
    if arguments.array_ids != list(map(id, arrays)) and not _set_arrays(arguments, arrays, plan, program):
        return False
    return all(map(is_, numbers, arguments.numbers)) or _set_numbers(arguments, numbers, plan)


def _set_arrays(arguments: LaunchArguments, arrays: tuple[Any, ...], plan: LaunchPlan, program: Any) -> bool:
    context = arguments.context
    for row, (value, known, parameter) in enumerate(zip(arrays, arguments.array_ids, plan.arrays, strict=True)):
        if id(value) == known:
            continue
        slot, kind, dtype, numpy_dtype, length, axes = parameter
        arguments.array_ids[row] = 0
        if type(value) is np.ndarray:
            fits = kind == UNTYPED or (kind == SCALAR_ARRAY and value.dtype is numpy_dtype and value.ndim == axes)
            if not (fits and value.flags.c_contiguous and value.nbytes < _MAX_BYTES):
                return False
            context.set_arg_external_array_with_shape(slot, value.ctypes.data, value.nbytes, value.shape, 0)
            continue
        if kind == SCALAR_ARRAY:
            fits = isinstance(value, ScalarNdarray) and value.element_type is dtype and len(value.shape) == axes
        elif kind == VECTOR_ARRAY:
            fits = isinstance(value, VectorNdarray) and value.dtype is dtype and value.n == length
            fits = fits and len(value.shape) == axes
        else:
            fits = isinstance(value, (ScalarNdarray, VectorNdarray))
        if not fits or value.grad is not None:
            return False
        restart.check_array(value)
        if plan.keeps_arguments:
            address, size = program.get_ndarray_data_ptr_as_int(value.arr), _byte_count(value.arr)
            context.set_arg_external_array_with_shape(slot, address, size, value.shape, 0)
            arguments.keep_array(row, value)
        else:
            context.set_arg_ndarray(slot, value.arr)
    return True


def _set_numbers(arguments: LaunchArguments, numbers: tuple[Any, ...], plan: LaunchPlan) -> bool:
    context, last = arguments.context, arguments.numbers
    for row, (value, before, (slot, kind)) in enumerate(zip(numbers, last, plan.numbers, strict=True)):
        if value is before:
            continue
        if kind == INTEGER and type(value) is int:
            context.set_arg_int(slot, value)
        elif kind == REAL and type(value) in (int, float):
            context.set_arg_float(slot, float(value))
        else:
            return False
        last[row] = value
    return True


def _type_of(value: Any) -> tuple[Any, ...]:
    """Return what Taichi compiles a kernel for, of an array."""
    dtype = getattr(value, "dtype", None)
    return type(value), dtype, getattr(value, "n", None), len(getattr(value, "shape", ()))


def _byte_count(array: Any) -> int:
    """Return the size of an array in bytes, at least 1: for Taichi, 0 means that there is no array."""
    return max(int(array.nelement() * array.element_size()), 1)


def _plan(kernel: Any) -> LaunchPlan:
    integers = (primitive_types.i32,), (primitive_types.i64,)
    returns_integer = kernel.return_type is not None and tuple(kernel.return_type) in integers
    unsupported = LaunchPlan(kernel.runtime, supported=False)
    if kernel.classkernel or kernel.autodiff_mode != kernel_impl.AutodiffMode.NONE:
        return unsupported
    if kernel.return_type is not None and not returns_integer:
        return unsupported
    on_cpu = ti.cfg.arch in (ti.x64, ti.arm64)
    plan = LaunchPlan(kernel.runtime, keeps_arguments=on_cpu, returns_integer=returns_integer)
    arrays: list[int] = []  # rows of the arguments
    numbers: list[int] = []
    templates: list[int] = []
    untyped: list[int] = []
    for row, argument in enumerate(kernel.arguments):
        annotation, slot = argument.annotation, (row - len(templates),)
        if isinstance(annotation, template):
            templates.append(row)
        elif isinstance(annotation, NdarrayType) and annotation.ndim is None:
            arrays.append(row)
            untyped.append(row)
            plan.arrays.append((slot, UNTYPED, None, None, 0, 0))
        elif isinstance(annotation, NdarrayType) and annotation.dtype is not None:
            dtype, axes = annotation.dtype, annotation.ndim
            arrays.append(row)
            if not isinstance(dtype, MatrixType):
                plan.arrays.append((slot, SCALAR_ARRAY, dtype, np.dtype(to_numpy_type(dtype)), 0, axes))
            elif dtype.ndim == 1:
                plan.arrays.append((slot, VECTOR_ARRAY, dtype.dtype, None, dtype.n, axes))
            else:
                return unsupported
        elif annotation is primitive_types.i32:
            numbers.append(row)
            plan.numbers.append((slot, INTEGER))
        elif annotation is primitive_types.f32 or annotation is primitive_types.f64:
            numbers.append(row)
            plan.numbers.append((slot, REAL))
        else:
            return unsupported
    plan.arrays_of, plan.numbers_of = _selector(arrays), _selector(numbers)
    plan.templates_of, plan.untyped_of = _selector(templates), _selector(untyped)
    return plan


def _selector(rows: list[int]) -> Callable[[tuple[Any, ...]], tuple[Any, ...]]:
    """Return a function that selects rows of a tuple."""
    if not rows:
        return _nothing
    return itemgetter(*rows) if len(rows) > 1 else itemgetter(slice(rows[0], rows[0] + 1))
