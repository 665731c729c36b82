# SPDX-License-Identifier: Apache-2.0
"""What Taichi does in Python before a kernel runs: once for each function, not again wherever it is called.

Taichi inlines a function at each of its calls. Taichi 1.7.4 reads, wraps and parses its source for each of them, words
where each node of its syntax tree stands, should an error have to say so, and looks through all modules for the source
around each decorator. Here a function's source and tree serve all of its calls: the same kernels, under the same names
in Taichi's cache, in half the time. What comes of it is kept for the next process (`recordings`).
"""

from __future__ import annotations

import ast
import functools
import gc
import sys
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any

from taichi.lang import kernel_impl
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext

from tiscene.device.taichi_patches import ast_recorder, fingerprint

_materialize: Any = kernel_impl.Kernel.materialize
_walk: Any = kernel_impl.transform_tree


def use() -> None:
    """Prepare all kernels of this process so."""
    kernel_impl._inside_class = _inside_class
    kernel_impl._get_tree_and_ctx = _tree_and_context
    kernel_impl.transform_tree = _walked
    kernel_impl.Kernel.materialize = _prepared
    ASTTransformerContext.get_pos_info = _position


def _inside_class(level_of_class_stackframe: int) -> bool:
    """Whether the decorator that is so many calls up is used in the body of a class."""
    return "__qualname__" in sys._getframe(level_of_class_stackframe - 1).f_locals


@dataclass(eq=False)
class _Source:
    """A function as it is written. trees: parsed, those that nothing walks at the moment."""

    file: str
    lines: list[str]
    first_line: int
    trees: list[ast.Module] = field(default_factory=list)


@functools.cache
def _source(function: Any) -> _Source:
    with suppress(fingerprint.NoFingerprint):
        fingerprint.source_digest(function.__module__)  # before it is read: what it says is true from now on
    lines, first_line = kernel_impl.getsourcelines(function)
    lines = [textwrap.fill(line, tabsize=4, width=9999) for line in lines]
    return _Source(kernel_impl.getsourcefile(function), lines, first_line)


def _parsed(lines: list[str]) -> ast.Module:
    tree = ast.parse(textwrap.dedent("\n".join(lines)))
    tree.body[0].decorator_list = []  # type: ignore[attr-defined]
    return tree


def _tree_and_context(
    self: Any,
    excluded_parameters: Any = (),
    is_kernel: bool = True,
    arg_features: Any = None,
    args: Any = None,
    ast_builder: Any = None,
    is_real_function: bool = False,
) -> tuple[ast.Module, Any]:
    """A tree of the function and what is known while it is walked, as Taichi's own."""
    source, names = _source(self.func), kernel_impl._get_global_vars(self.func)
    if is_kernel or is_real_function:
        names |= {self.arguments[row].name: args[row] for row in self.template_slot_locations}
    context = ASTTransformerContext(
        excluded_parameters=excluded_parameters,
        is_kernel=is_kernel,
        func=self,
        arg_features=arg_features,
        global_vars=names,
        argument_data=args,
        src=source.lines,
        start_lineno=source.first_line,
        file=source.file,
        ast_builder=ast_builder,
        is_real_function=is_real_function,
    )
    return source.trees.pop() if source.trees else _parsed(source.lines), context


def _walked(tree: ast.Module, context: Any) -> Any:
    result = _walk(tree, context)
    if not (context.is_kernel or context.is_real_function):  # those have lost their arguments on the way
        _source(context.func.func).trees.append(tree)
    return result


def _position(self: Any, node: Any) -> str:
    """What an error says of where a node stands: the file and the line, and below, which part of it."""
    try:
        return node.position  # type: ignore[no-any-return]
    except AttributeError:
        line, first = self.src[node.lineno - 1].rstrip(), self.indent + node.col_offset
        last = self.indent + node.end_col_offset if node.lineno == node.end_lineno else len(line)
        node.position = (
            f'File "{self.file}", line {node.lineno + self.lineno_offset}, in {self.func.func.__name__}:\n'
            f"{line}\n{' ' * first}{'^' * (last - first)}\n"
        )
        return node.position  # type: ignore[no-any-return]


def _prepared(self: Any, key: Any = None, args: Any = None, arg_features: Any = None) -> None:
    if key is None or key not in self.compiled_kernels:
        with _without_collection():
            ast_recorder.prepare(self, key, args, arg_features, _materialize)


@contextmanager
def _without_collection() -> Iterator[None]:
    """A kernel's syntax trees are many objects, all of them needed: looking for garbage among them finds none."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
