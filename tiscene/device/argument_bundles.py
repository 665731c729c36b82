# SPDX-License-Identifier: Apache-2.0
"""Named tuples as parameters of kernels.

A Taichi kernel takes arrays one by one, and a kernel that shades needs more than thirty. Below ``@ti.kernel``,
``@bundled`` lets a parameter be a NamedTuple whose fields are annotated with types of kernel arguments::

    class Materials(NamedTuple):
        values: Floats2
        info: Ints2

    @ti.kernel
    @bundled
    def shade(
        materials: Materials,
        count: ti.i32,
    ):
        \"\"\"Docstring.\"\"\"

    shade(*materials, count)

Taichi reads the source code of a kernel. It is given a copy in which such a parameter is replaced by one per field, and
the tuple is made of them at compile time. Launches and compiled code are the same as with the fields written out, and
so are line numbers. (A launch with an argument pack of Taichi 1.7.4, `ti.types.argpack`, takes seven times as long.)
"""

from __future__ import annotations

import inspect
import linecache
import re
from collections.abc import Callable
from types import CodeType
from typing import Any, TypeVar

_Kernel = TypeVar("_Kernel", bound=Callable[..., Any])


def bundled(function: _Kernel) -> _Kernel:
    """Replace the parameters of a kernel's function that are NamedTuples by one parameter per field.

    Args:
        function: The function, not decorated by ``ti.kernel`` yet. Each NamedTuple parameter stands on a line of its
            own, and a docstring follows the signature.

    Returns:
        A function whose parameters are the fields, named ``parameter_field``.
    """
    code = function.__code__
    lines = _source_lines(function)
    definition = next(row for row, line in enumerate(lines) if line.startswith("def "))
    docstring = next(row for row, line in enumerate(lines) if row > definition and line.lstrip().startswith('"""'))
    lines[:definition] = ["\n"] * definition  # decorators
    tuples = ""
    for row in range(definition, docstring):
        match = re.fullmatch(r"\s+(\w+): (\w+),\n", lines[row])
        bundle: Any = function.__globals__.get(match[2]) if match else None
        if match and hasattr(bundle, "_fields"):
            parameter, kind = match.groups()
            fields = [(f"{parameter}_{field}", f"{kind}.__annotations__[{field!r}]") for field in bundle._fields]
            lines[row] = f"    {', '.join(f'{name}: {annotation}' for name, annotation in fields)},\n"
            tuples += f"{parameter} = ti.static({kind}({', '.join(name for name, _ in fields)})); "
    lines[docstring] = f"    {tuples}{lines[docstring].lstrip()}"
    lines[:0] = ["\n"] * (code.co_firstlineno - 1)
    file = f"<{function.__module__}.{function.__qualname__}, bundled>"
    source = "".join(lines)
    linecache.cache[file] = len(source), None, lines, file
    namespace: dict[str, Any] = {}
    exec(compile(source, file, "exec", dont_inherit=True), function.__globals__, namespace)
    result: _Kernel = namespace[function.__name__]
    return result


def _source_lines(function: Any) -> list[str]:
    """Return the source of a function, decorators included."""
    code: CodeType = function.__code__
    ends = [end for _, end, _, _ in code.co_positions() if end is not None]
    if not ends:  # Python runs without positions
        return inspect.getsourcelines(function)[0]
    return linecache.getlines(code.co_filename, function.__globals__)[code.co_firstlineno - 1 : max(ends)]
