# SPDX-License-Identifier: Apache-2.0
"""No kernel that is compiled in vector mode does what is silently wrong there.

The kernels are those called inside `with vector_mode():` in the sources of tiscene. Every Taichi function that they can
reach by name is checked by its AST, for two rules of `vector_mode`:

- no lane of a vector comparison is read: neither `(a > b)[k]` nor `mask[k]` with `mask = a > b`, nor in a function that
  is passed such a mask;
- a kernel makes no vector before its loops, where it would not be aligned.
"""

import ast
import functools
import importlib
import inspect
import textwrap
import types
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import taichi as ti

import tiscene
from tiscene.device import runtime
from tiscene.device.vector_mode import vector_mode

PACKAGE = Path(tiscene.__file__).parent
LANES = {"x", "y", "z", "w", "any", "all", "sum"}  # attributes that read single lanes
VECTOR_MAKERS = {"Vector", "Matrix", "vec2", "vec3", "vec4", "float4", "float8", "int8", "uint3"}


def python_function(value) -> types.FunctionType | None:
    """Return the Python function of a Taichi kernel or function, None for any other value."""
    if getattr(value, "_is_wrapped_kernel", False):
        return value._primal.func
    if getattr(value, "_is_taichi_function", False):
        return value.func.func
    return None


@functools.cache
def tree_of(function: types.FunctionType) -> ast.FunctionDef:
    return ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]


def resolve(node: ast.expr, names: dict[str, object]) -> object:
    """Return what a name or a dotted name stands for, None if that is not known."""
    if isinstance(node, ast.Name):
        return names.get(node.id)
    if isinstance(node, ast.Attribute):
        return getattr(resolve(node.value, names), node.attr, None)
    return None


def vector_mode_calls() -> Iterator[tuple[str, types.FunctionType]]:
    """Yield every kernel that is called inside `with vector_mode():`, with the place of the call."""
    for path in sorted(PACKAGE.rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        if "vector_mode()" not in source or path.name == "vector_mode.py":
            continue
        relative = path.relative_to(PACKAGE.parent)
        names = vars(importlib.import_module(".".join(relative.with_suffix("").parts)))
        for function in ast.walk(ast.parse(source)):
            if isinstance(function, ast.FunctionDef):
                for block in ast.walk(function):
                    if isinstance(block, ast.With) and any("vector_mode()" in ast.unparse(i) for i in block.items):
                        yield from kernels_in(block, function, names, str(relative))


def kernels_in(block: ast.With, function: ast.FunctionDef, names: dict[str, object], file: str):
    for call in ast.walk(ast.Module(block.body, [])):
        if not isinstance(call, ast.Call):
            continue
        found = [resolve(call.func, {**names, **choice}) for choice in choices(call.func, function, names)]
        for kernel in filter(None, map(python_function, found)):
            yield f"{file}:{call.lineno}", kernel


def choices(callee: ast.expr, function: ast.FunctionDef, names: dict[str, object]) -> Iterator[dict[str, object]]:
    """Yield what the first name of a callee may stand for: each value that the function assigns to it."""
    yield {}
    root = next(node for node in ast.walk(callee) if isinstance(node, ast.Name)) if has_name(callee) else None
    for statement in ast.walk(function):
        if root and isinstance(statement, ast.Assign) and ast.unparse(statement.targets[0]) == root.id:
            for each in ast.walk(statement.value):
                if isinstance(each, ast.Name | ast.Attribute):
                    yield {root.id: resolve(each, names)}


def has_name(node: ast.expr) -> bool:
    return any(isinstance(each, ast.Name) for each in ast.walk(node))


def named_functions(function: types.FunctionType) -> Iterator[types.FunctionType]:
    """Yield the Taichi functions that a function names: directly, in modules, and in tuples, lists and dicts."""
    names = {name for node in ast.walk(tree_of(function)) for name in identifiers(node)}
    closure = inspect.getclosurevars(function)
    pending = [value for name, value in {**function.__globals__, **closure.nonlocals}.items() if name in names]
    seen = set()
    while pending:
        value = pending.pop()
        if id(value) in seen:
            continue
        seen.add(id(value))
        if (found := python_function(value)) is not None:
            yield found
        elif isinstance(value, types.ModuleType) and value.__name__.startswith("tiscene"):
            pending += [member for name, member in vars(value).items() if name in names]
        elif isinstance(value, tuple | list):
            pending += value
        elif isinstance(value, dict):
            pending += value.values()


def identifiers(node: ast.AST) -> tuple[str, ...]:
    if isinstance(node, ast.Name):
        return (node.id,)
    return (node.attr,) if isinstance(node, ast.Attribute) else ()


def reachable(kernels: set[types.FunctionType]) -> set[types.FunctionType]:
    found, pending = set(kernels), list(kernels)
    while pending:
        for function in named_functions(pending.pop()):
            if function not in found and function.__module__.startswith(("tiscene", __name__)):
                found.add(function)
                pending.append(function)
    return found


def lane_reads(functions: set[types.FunctionType]) -> list[str]:
    """Return the places where a lane of a comparison is read."""
    by_name: dict[str, list[types.FunctionType]] = {}
    for function in functions:
        by_name.setdefault(function.__name__, []).append(function)
    masks: dict[types.FunctionType, set[str]] = {function: set() for function in functions}
    returning: set[str] = set()  # names of functions that return a mask
    before = None
    while before != (before := (sum(map(len, masks.values())), len(returning))):
        for function in functions:
            for node in ast.walk(tree_of(function)):
                if isinstance(node, ast.Assign | ast.AnnAssign) and is_mask(node.value, masks[function], returning):
                    targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                    masks[function].update(each.id for each in targets if isinstance(each, ast.Name))
                elif isinstance(node, ast.Return) and is_mask(node.value, masks[function], returning):
                    returning.add(function.__name__)
                elif isinstance(node, ast.Call):
                    for callee in by_name.get(ast.unparse(node.func).split(".")[-1], ()):
                        parameters = [argument.arg for argument in tree_of(callee).args.args]
                        for parameter, argument in zip(parameters, node.args, strict=False):
                            if is_mask(argument, masks[function], returning):
                                masks[callee].add(parameter)
    return sorted(
        f"{function.__module__}.{function.__name__}: {ast.unparse(node)}"
        for function in functions
        for node in ast.walk(tree_of(function))
        if (isinstance(node, ast.Subscript) or (isinstance(node, ast.Attribute) and node.attr in LANES))
        and is_mask(node.value, masks[function], returning)
    )


def is_mask(node: ast.expr | None, masks: set[str], returning: set[str]) -> bool:
    """Return whether an expression may be a comparison of vectors."""
    match node:
        case ast.Compare():
            return True
        case ast.BoolOp(values=parts):
            return any(is_mask(part, masks, returning) for part in parts)
        case ast.UnaryOp(op=ast.Not() | ast.Invert(), operand=operand):
            return is_mask(operand, masks, returning)
        case ast.BinOp(left=left, op=ast.BitAnd() | ast.BitOr() | ast.BitXor(), right=right):
            return is_mask(left, masks, returning) or is_mask(right, masks, returning)
        case ast.Name(id=name):
            return name in masks
        case ast.Call(func=callee):
            return ast.unparse(callee).split(".")[-1] in returning
    return False


def vectors_before_loops(kernel: types.FunctionType) -> list[str]:
    """Return the statements of a kernel outside its loops that make a vector."""
    outside = [node for node in tree_of(kernel).body if not isinstance(node, ast.For)]
    return [
        f"{kernel.__module__}.{kernel.__name__}: {ast.unparse(statement)}"
        for statement in outside
        if any(isinstance(node, ast.Call) and makes_vector(node, kernel.__globals__) for node in ast.walk(statement))
    ]


def makes_vector(call: ast.Call, names: dict[str, object]) -> bool:
    """Return whether a call makes a vector: a constructor, or a Taichi function that does."""
    if ast.unparse(call.func).split(".")[-1] in VECTOR_MAKERS:
        return True
    function = python_function(resolve(call.func, names))
    if function is None:
        return False
    inner = [node for node in ast.walk(tree_of(function)) if isinstance(node, ast.Call)]
    return any(makes_vector(node, function.__globals__) for node in inner)


def kernels() -> set[types.FunctionType]:
    return {kernel for _, kernel in vector_mode_calls()}


def test_every_vector_mode_block_is_found():
    found = {(place.partition(":")[0].split("/")[-1], kernel.__name__) for place, kernel in vector_mode_calls()}
    assert found >= {
        ("trace.py", "closest"),
        ("trace.py", "occluded"),
        ("path_pass.py", "start_paths"),
        ("path_pass.py", "finish_at_lights"),
        ("path_retracer.py", "cull_rays"),
    }
    assert {"bvh8", "bvh8_packets", "bvh8_any_hit"} <= {kernel.__module__.split(".")[-1] for kernel in kernels()}
    assert any(kernel.__name__.startswith("shade") for kernel in kernels())
    names = {function.__name__ for function in reachable(kernels())}
    assert len(names) > 100, "shading reaches BSDFs, textures and lights"


def test_kernels_read_no_lane_of_a_comparison():
    assert lane_reads(reachable(kernels())) == []


def test_kernels_make_no_vector_before_their_loops():
    assert [problem for kernel in kernels() for problem in vectors_before_loops(kernel)] == []


float8 = ti.types.vector(8, ti.f32)


@ti.func
def first_lane(mask):
    return mask[0]


@ti.func
def above(a, b):
    return a > b


@ti.kernel
def wrong(values: ti.types.ndarray(float8, 1), result: ti.types.ndarray(ti.i32, 1)):
    limit = float8(0.0)
    for i in range(1):
        mask = values[i] > limit
        result[0] = mask[3]
        result[1] = (values[i] > limit)[3]
        result[2] = first_lane(not mask)
        result[3] = above(values[i], limit).x


@ti.kernel
def right(values: ti.types.ndarray(float8, 1), result: ti.types.ndarray(ti.i32, 1)):
    for i in range(1):
        limit = float8(0.0)
        chosen = ti.select(values[i] > limit, values[i], limit)
        result[0] = chosen[3] > 0.0


def test_check_finds_wrong_operations():
    functions = reachable({wrong._primal.func})
    assert functions == {wrong._primal.func, first_lane.func.func, above.func.func}
    found = {problem.partition(": ")[2] for problem in lane_reads(functions)}
    assert found == {"mask[3]", "(values[i] > limit)[3]", "mask[0]", "above(values[i], limit).x"}
    assert [problem.partition(": ")[2] for problem in vectors_before_loops(wrong._primal.func)] == [
        "limit = float8(0.0)"
    ]
    assert lane_reads({right._primal.func}) == vectors_before_loops(right._primal.func) == []


def test_vector_mode_ends_after_an_error():
    def fail_inside() -> None:
        with vector_mode():
            assert not ti.cfg.real_matrix_scalarize
            raise KeyError

    runtime.start()
    before = ti.cfg.real_matrix_scalarize
    with pytest.raises(KeyError):
        fail_inside()
    assert ti.cfg.real_matrix_scalarize == before


def test_right_kernel_gives_the_same_in_vector_mode():
    runtime.start()
    values, result = ti.ndarray(float8, 1), ti.ndarray(ti.i32, 1)
    values.from_numpy(np.arange(-2, 6, dtype=np.float32).reshape(1, 8))
    with vector_mode():
        right(values, result)
    assert result[0] == 1
