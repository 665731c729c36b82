# SPDX-License-Identifier: Apache-2.0
"""Leave out the copies, casts and constant expressions that the compiler would have to remove.

Taichi copies each argument and result of an inlined function into a variable of its own, casts values to the type that
they have, and leaves arithmetic with constants to the compiler. The compiler replaces such statements one by one, and
searches the whole kernel for uses of each. Here the calls that make them are left out of a recording, and so are
variables that the next statement alone reads: the shading kernel compiles in less than two thirds of the time. What a
kernel computes stays the same, to the bit.
"""

from __future__ import annotations

import json
import operator
from collections import defaultdict
from collections.abc import Container, Mapping, Sequence
from typing import Any

import numpy as np

from tiscene.device.taichi_patches.recorded_calls import SIDE_EFFECTS
from tiscene.device.taichi_patches.recording_file import CONFIG

# A call as `ast_recorder.CallRecorder` keeps it: its name, and its arguments as pairs of kind and content.
Row = tuple[str, list[tuple[str, Any]]]

CHECK, CAST = "Expr.type_check", "value_cast"
VARIABLE, ASSIGNMENT, BRANCH = "ASTBuilder.expr_var", "ASTBuilder.expr_assign", "ASTBuilder.begin_frontend_if"

_CONSTANTS = {"i32": "make_const_expr_int", "u32": "make_const_expr_int", "f32": "make_const_expr_fp"}
_ARITHMETIC = {"expr_add": operator.add, "expr_sub": operator.sub, "expr_mul": operator.mul}
# Calls that cast an integer to the type of the other operand, if that has one of the types above.
_PROMOTING = {*_ARITHMETIC, "expr_truediv", "expr_max", "expr_min", "expr_bit_and", "expr_bit_or", "expr_bit_xor"}
_PROMOTING |= {f"expr_cmp_{name}" for name in ("eq", "ne", "lt", "le", "gt", "ge")}

_WHOLES = {"ASTBuilder.expr_subscript": 1, "subscript_with_multiple_indices": 0}  # which argument the result is part of
_MEMBERS = {"list": 0, "ExprGroup.push_back": 1}  # the first of the arguments that become members
# Calls that only read their arguments, besides all others that make an expression of expressions.
_READERS = {CHECK, CAST, VARIABLE, BRANCH, "bits_cast", "ASTBuilder.make_matrix_expr", *_WHOLES, *_MEMBERS}
_LEAVES = {"ExprGroup", "make_arg_load_expr", "make_external_tensor_expr", "get_external_tensor_shape_along_axis"}
_LEAVES |= {"Kernel.ast_builder", "Kernel.insert_ndarray_param", "Kernel.insert_scalar_param"}
_LAZY = {"expr_ifte", "expr_logical_and", "expr_logical_or"}  # may leave out operands
_EXPRESSIONS = {"ASTBuilder.expr_subscript", "ASTBuilder.make_matrix_expr", "ASTBuilder.make_id_expr"}


def simplified(rows: Sequence[Row], types: Mapping[int, str]) -> list[Row]:
    """Return calls that build the same kernel with fewer variables and expressions.

    Args:
        rows: All calls that build the kernel's AST.
        types: The type of each expression, by the row that made it.
    """
    rows = _used(_SimplerCalls(rows, types).rows)
    values = passed_values(rows)

    def value_of(row: int) -> int:
        while row in values:
            row = values[row]
        return row

    rows = [
        (name, [(kind, value_of(content) if kind == "result" else content) for kind, content in arguments])
        for name, arguments in rows
    ]
    return _used(rows, values)


class _SimplerCalls:
    """Calls without copies, casts and constant expressions; arguments as of `simplified`.

    Attributes:
        rows: The new calls. The results of some are not used.
    """

    def __init__(self, rows: Sequence[Row], types: Mapping[int, str]) -> None:
        self.rows: list[Row] = []
        self._types: dict[int, str] = {}  # by new row, as all that follow
        self._values: dict[int, int | float] = {}  # of constants
        self._stable: set[int] = set()  # variables that keep their first value
        written = written_rows(rows)
        places: list[int] = []  # the new row of each
        for row, (name, given) in enumerate(rows):
            arguments = [(kind, places[content] if kind == "result" else content) for kind, content in given]
            if name in _PROMOTING:
                (_, first), (_, second) = arguments
                arguments = [("result", self._promoted(first, second)), ("result", self._promoted(second, first))]
            is_stable = name == VARIABLE and row not in written
            place = self._simpler(name, arguments, is_stable)
            if place is None:
                place = self._add(name, arguments, types.get(row))
                if is_stable:
                    self._stable.add(place)
            places.append(place)

    def _simpler(self, name: str, arguments: list[tuple[str, Any]], is_stable: bool) -> int | None:
        """Return a row, perhaps a new one, that takes the place of a call; None if the call is needed."""
        operands = _operands(arguments)
        if is_stable:
            start = operands[-1]
            return start if start in self._values or start in self._stable else None
        if name == CAST:
            return self._cast(operands[0], _type_name(arguments[1]))
        if name in _ARITHMETIC and all(each in self._values for each in operands):
            type_name, other = (self._types[each] for each in operands)
            if type_name == other != "f32":
                return self._constant(type_name, _ARITHMETIC[name](*(self._values[each] for each in operands)))
        return None

    def _cast(self, operand: int, type_name: str | None) -> int | None:
        """Return a row with an operand in another type; None if it takes a cast."""
        if self._types.get(operand) == type_name is not None:
            return operand
        if operand in self._values and type_name in _CONSTANTS and self._types[operand] != "f32":
            return self._constant(type_name, self._values[operand])
        return None

    def _constant(self, type_name: str, value: float) -> int:
        """Add a constant and return its row."""
        if type_name == "f32":
            value = float(np.float32(value))
        else:  # as an integer of 32 bits, which wraps
            value = int(value) & 0xFFFFFFFF
            value -= (value >> 31 << 32) * (type_name == "i32")
        arguments = [("constant", json.dumps(each)) for each in (["type", type_name], value)]
        place = self._add(_CONSTANTS[type_name], arguments, type_name)
        self._add(CHECK, [("result", place), ("fixed", CONFIG)], None)
        return place

    def _add(self, name: str, arguments: list[tuple[str, Any]], type_name: str | None) -> int:
        """Add a call and return its row."""
        place = len(self.rows)
        self.rows.append((name, arguments))
        if type_name is not None:
            self._types[place] = type_name
        if name in _CONSTANTS.values() and type_name in _CONSTANTS:
            self._values[place] = json.loads(arguments[1][1])
        return place

    def _promoted(self, operand: int, other: int) -> int:
        """Return a row with an operand in the type of the other, if Taichi would cast it to that."""
        if operand in self._values and self._types[operand] == "i32" and self._types.get(other) in ("u32", "f32"):
            return self._constant(self._types[other], self._values[operand])
        return operand


def written_rows(rows: Sequence[Row]) -> set[int]:
    """Return the rows of all expressions that, or parts of which, a call may write to."""
    members: dict[int, list[int]] = defaultdict(list)  # of lists and groups
    written: set[int] = set()
    for row, (name, arguments) in enumerate(rows):
        operands = _operands(arguments)
        if name in _MEMBERS:
            group = row if name == "list" else operands[0]
            members[group] += operands[_MEMBERS[name] :]
        if name == ASSIGNMENT:
            pending = [arguments[1][1]]
        elif name.startswith("expr_atomic_"):
            pending = [arguments[0][1]]
        elif _only_reads(name):
            pending = []
        else:
            pending = operands
        while pending:
            place = pending.pop()
            if place not in written:
                written.add(place)
                pending += members[place]
                if rows[place][0] in _WHOLES:
                    pending.append(rows[place][1][_WHOLES[rows[place][0]]][1])
    return written


def passed_values(rows: Sequence[Row]) -> dict[int, int]:
    """Find variables that one expression of the next statement reads, and nothing else.

    Args:
        rows: All calls that build the kernel's AST.

    Returns:
        The row of the value that can be used in place of each such variable, by the variable's row.
    """
    users: dict[int, list[int]] = defaultdict(list)
    harmless = [True] * len(rows)  # whether evaluating an expression changes nothing
    statements = []
    for row, (name, arguments) in enumerate(rows):
        operands = _operands(arguments)
        if name == "ExprGroup.push_back":
            group, member = operands
            users[member].append(group)
            harmless[group] = harmless[group] and harmless[member]
        elif name != CHECK:
            for operand in operands:
                users[operand].append(row)
            if name.startswith("ASTBuilder.") and name not in _EXPRESSIONS:
                statements.append(row)
            else:
                known = _only_reads(name) or name.split()[0] in _LEAVES
                harmless[row] = known and all(harmless[operand] for operand in operands)
    written = written_rows(rows)
    values: dict[int, int] = {}

    def reader(row: int) -> int | None:
        """Return the statement that evaluates an expression, if it does so once and for certain."""
        while len(users[row]) == 1:
            (row,) = users[row]
            name = rows[row][0]
            if name in (VARIABLE, ASSIGNMENT, BRANCH) and row not in values:
                return row
            if name in _LAZY or not harmless[row]:
                break
        return None

    following: int | None = None  # the next statement that is not left out
    for row in reversed(statements):
        name, arguments = rows[row]
        if name == VARIABLE and following is not None and row not in written and reader(row) == following:
            value, (user, *_) = arguments[1][1], users[row]
            read = _operands(rows[following][1])
            if rows[user][0] not in _WHOLES and harmless[value] and all(harmless[each] for each in read):
                values[row] = value
                continue
        following = row
    return values


def _used(rows: Sequence[Row], unused: Container[int] = ()) -> list[Row]:
    """Return the calls with side effects, but for variables that are `unused`, and those whose results are used.

    The type of an expression is checked once.
    """
    needed = [name.split()[0] in SIDE_EFFECTS and name != CHECK for name, _ in rows]
    for row in range(len(rows) - 1, -1, -1):
        needed[row] = needed[row] and row not in unused
        if needed[row]:
            for operand in _operands(rows[row][1]):
                needed[operand] = True
    places: dict[int, int] = {}
    checked: set[int] = set()
    result: list[Row] = []
    for row, (name, arguments) in enumerate(rows):
        if name == CHECK:
            expression = arguments[0][1]
            needed[row] = needed[expression] and expression not in checked
            checked.add(expression)
        if needed[row]:
            places[row] = len(result)
            result.append((name, [(kind, places[each] if kind == "result" else each) for kind, each in arguments]))
    return result


def _operands(arguments: list[tuple[str, Any]]) -> list[int]:
    """Return the rows whose results a call takes."""
    return [content for kind, content in arguments if kind == "result"]


def _only_reads(name: str) -> bool:
    is_expression = name.startswith(("expr_", "make_const_expr_")) and not name.startswith("expr_atomic_")
    return is_expression or name in _READERS or name in _EXPRESSIONS


def _type_name(argument: tuple[str, Any]) -> str | None:
    """Return the name of an argument that is a type of numbers; None if it is another type."""
    if argument[0] != "constant":
        return None
    kind, *content = json.loads(argument[1])
    return content[0] if kind == "type" else None
