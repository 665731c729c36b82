# SPDX-License-Identifier: Apache-2.0
"""The functions of Taichi's C++ library by which its Python front end builds a kernel's AST.

They create expressions and types, insert statements, and declare a kernel's parameters and results. The tables are
complete for Taichi 1.7.4; a test compares them with the library's signatures.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from taichi._lib import core

# Module functions that return an expression, several of them, or the factory of types.
_FUNCTION_NAMES = """
    bits_cast expr_abs expr_acos expr_add expr_asin expr_assume_in_range expr_atan2 expr_atomic_add expr_atomic_bit_and
    expr_atomic_bit_or expr_atomic_bit_xor expr_atomic_max expr_atomic_min expr_atomic_mul expr_atomic_sub expr_bit_and
    expr_bit_not expr_bit_or expr_bit_sar expr_bit_shl expr_bit_shr expr_bit_xor expr_ceil expr_clz expr_cmp_eq
    expr_cmp_ge expr_cmp_gt expr_cmp_le expr_cmp_lt expr_cmp_ne expr_cos expr_div expr_exp expr_field expr_floor
    expr_floordiv expr_frexp expr_ifte expr_inv expr_log expr_logic_not expr_logical_and expr_logical_or
    expr_loop_unique expr_matrix_field expr_max expr_min expr_mod expr_mul expr_neg expr_popcnt expr_pow expr_rcp
    expr_round expr_rsqrt expr_select expr_sin expr_sqrt expr_sub expr_tan expr_tanh expr_truediv
    get_external_tensor_real_func_args get_external_tensor_shape_along_axis get_relation_access get_relation_size
    get_type_factory_instance insert_internal_func_call make_arg_load_expr make_binary_op_expr make_const_expr_bool
    make_const_expr_fp make_const_expr_int make_external_tensor_expr make_external_tensor_grad_expr
    make_get_element_expr make_rand_expr make_reference make_rw_texture_ptr_expr make_texture_ptr_expr
    make_unary_op_expr subscript_with_multiple_indices value_cast
"""

# Methods, by class: the beginnings of their names.
_METHOD_PREFIXES: dict[Any, tuple[str, ...]] = {
    core.ASTBuilder: ("",),
    core.Expr: ("type_check",),
    core.ExprGroup: ("push_back",),
    core.TypeFactory: ("get_",),
    core.Kernel: ("insert_", "finalize_", "ast_builder"),
}

FUNCTIONS: dict[str, Callable[..., Any]] = {
    name: getattr(core, name) for name in _FUNCTION_NAMES.split() if hasattr(core, name)
}
METHODS: dict[tuple[Any, str], Callable[..., Any]] = {
    (owner, name): method
    for owner, prefixes in _METHOD_PREFIXES.items()
    for name, method in vars(owner).items()
    if not name.startswith("_") and name.startswith(prefixes)
}

# All calls of a recording, by name. The last two take and make Python lists.
CALLS: dict[str, Callable[..., Any]] = {
    **FUNCTIONS,
    **{f"{owner.__name__}.{name}": method for (owner, name), method in METHODS.items()},
    "ExprGroup": core.ExprGroup,
    "item": operator.getitem,
    "list": lambda *values: list(values),
}

# Calls with side effects. The others are replayed only if their results are used.
SIDE_EFFECTS = {
    f"{owner.__name__}.{name}" for owner, name in METHODS if owner is not core.TypeFactory and name != "ast_builder"
}
