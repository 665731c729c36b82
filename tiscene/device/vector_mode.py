# SPDX-License-Identifier: Apache-2.0
"""Vector mode: compile kernels so that Taichi vectors become SIMD registers.

`real_matrix_scalarize`, a configuration entry of Taichi that is not documented, decides whether vectors are split into
scalars before code generation. With it off, LLVM emits SIMD instructions, and traversal of 8-wide nodes is 1.1 times as
fast. Not all operations work in this mode.

Right: + - * /, min, max, `select` on a comparison, dot, norm, and reading lanes.

Abort the process, on vectors: unary minus, `abs`, `cast`, `bit_cast`, `exp`, `log`, `pow`, `sign` and the trigonometric
functions.

Silently wrong: a lane of a vector comparison, and vectors made in a kernel before its loops, which are not aligned.
tests/device/test_vector_mode.py checks that no kernel compiled in vector mode reaches such an operation.
"""

from types import TracebackType

import taichi as ti
from taichi.lang import impl


class vector_mode:
    """Compile kernels that are called for the first time inside the context in vector mode; on CUDA as usual.

    Traversal kernels and kernels that shade paths use it. tests/render/intersect/test_intersect.py compares the former
    with the scalar mode.
    """

    __slots__ = "_before", "_config"  # no generator: every launch of these kernels enters it

    def __enter__(self) -> None:
        self._config = config = impl.current_cfg()
        self._before = config.real_matrix_scalarize
        config.real_matrix_scalarize = config.arch == ti.cuda

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._config.real_matrix_scalarize = self._before
