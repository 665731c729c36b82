# SPDX-License-Identifier: Apache-2.0
"""A faster front end: the source and the parsed tree of a function serve all of its calls.

Taichi inlines a function at each call. Taichi 1.7.4 reads and parses its source anew for each of them, and composes the
text of an error message for every node of the syntax tree. Here both happen at most once. The kernels are the same,
under the same names in Taichi's cache, in half the time.

Taichi's functions are replaced only while one of this project's kernels compiles, and restored afterwards.
"""

from __future__ import annotations

import ast
import functools
import gc
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any

from taichi.lang import kernel_impl
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext

from tiscene.device.taichi_patches import fingerprint

_transform: Any = kernel_impl.transform_tree


@contextmanager
def patched_frontend() -> Iterator[None]:
    """Use the faster front end inside the context, without garbage collection."""
    replacements = (
        (kernel_impl, "_get_tree_and_ctx", _tree_and_context),
        (kernel_impl, "transform_tree", _transformed),
        (ASTTransformerContext, "get_pos_info", _position),
    )
    originals = [(owner, name, getattr(owner, name)) for owner, name, _ in replacements]
    collects = gc.isenabled()
    gc.disable()  # the trees are many objects, and all of them are alive until the kernel exists
    try:
        for owner, name, replacement in replacements:
            setattr(owner, name, replacement)
        yield
    finally:
        for owner, name, original in originals:
            setattr(owner, name, original)
        if collects:
            gc.enable()


@dataclass(eq=False)
class FunctionSource:
    """The source of a function.

    Attributes:
        file: Its path.
        lines: Its lines, decorators included.
        first_line: The number of the first of them.
        trees: Parsed trees that no call uses at the moment. A recursive function needs several.
    """

    file: str
    lines: list[str]
    first_line: int
    trees: list[ast.Module] = field(default_factory=list)


@functools.cache
def _source(function: Any) -> FunctionSource:
    with suppress(fingerprint.NoFingerprint):
        fingerprint.source_digest(function.__module__)  # before the file is read, so that a later change is noticed
    lines, first_line = kernel_impl.getsourcelines(function)
    lines = [textwrap.fill(line, tabsize=4, width=9999) for line in lines]
    return FunctionSource(kernel_impl.getsourcefile(function), lines, first_line)


def _parse(lines: list[str]) -> ast.Module:
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
    """Replace `kernel_impl._get_tree_and_ctx`: return a tree of the function and the context of its transformation."""
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
    return source.trees.pop() if source.trees else _parse(source.lines), context


def _transformed(tree: ast.Module, context: Any) -> Any:
    """Replace `kernel_impl.transform_tree`: return its result, and keep the tree for the next call."""
    result = _transform(tree, context)
    if not (context.is_kernel or context.is_real_function):  # their transformation removes the arguments
        _source(context.func.func).trees.append(tree)
    return result


def _position(self: Any, node: Any) -> str:
    """Replace `ASTTransformerContext.get_pos_info`: return file, line and the marked source of a node, for errors."""
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
