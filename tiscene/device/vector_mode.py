# SPDX-License-Identifier: Apache-2.0
"""Vector mode: compile kernels so that Taichi vectors become SIMD registers."""

import contextlib
from collections.abc import Iterator

import taichi as ti


@contextlib.contextmanager
def vector_mode() -> Iterator[None]:
    """Kernels whose *first* call happens inside keep their vectors whole, so that LLVM emits true SIMD.

    An undocumented switch of Taichi (`real_matrix_scalarize`). In this mode vector operands of unary minus, `abs`,
    `cast`, `bit_cast`, `exp`, `log`, `pow`, `sign` and the trigonometric functions abort the process, and a vector
    comparison indexed by a lane is silently wrong; + - * /, min, max, `select`, dot, norm and lane reads are right.
    Traversal kernels use it, which tests/render/intersect/test_intersect.py compares with the scalar mode, and those
    that shade paths: nothing that these call may do the above, and no vector be made before their loops, where it is
    not aligned.
    """
    before = ti.cfg.real_matrix_scalarize
    ti.cfg.real_matrix_scalarize = False
    try:
        yield
    finally:
        ti.cfg.real_matrix_scalarize = before
