# SPDX-License-Identifier: Apache-2.0
"""The class of this project's kernels, and the hook in `ti.kernel` that selects them.

`ti.kernel` creates a `taichi.lang.kernel_impl.Kernel`. For a function of the packages that `fence` names, the new
object's class becomes `PatchedKernel`, a subclass with a faster `__call__` and `materialize`. No method of Taichi's
classes of kernels and functions is replaced, so that the kernels of other packages are not affected.

Two functions of Taichi stay replaced, and both call the original for other packages: `_kernel_impl`, which creates a
kernel, and `_inside_class`, which decides whether a decorator is used in a class body. The original of the latter
searches all loaded modules for the decorator's source at each of this project's 400 decorators.
"""

from __future__ import annotations

import sys
import threading
from typing import Any

from taichi.lang import impl, kernel_impl
from taichi.lang.enums import AutodiffMode
from taichi.lang.kernel_impl import Kernel

from tiscene.device.taichi_patches import ast_recorder, fence, frontend, launch, memcpy, tracebacks

_create_kernel: Any = kernel_impl._kernel_impl
_is_inside_class: Any = kernel_impl._inside_class
LOCK = threading.RLock()  # Taichi's front end keeps its state in globals


class PatchedKernel(Kernel):  # type: ignore[misc]  # Taichi has no types
    """A kernel that is launched and compiled with less Python.

    Attributes:
        launch_plan: How arguments are set; None before the first call.
    """

    launch_plan: launch.LaunchPlan | None = None
    __call__ = launch.launch

    def materialize(self, key: Any = None, args: Any = None, arg_features: Any = None) -> None:
        """Create the kernel's AST for arguments of the given types, from a recording if there is one."""
        if key is not None and key in self.compiled_kernels:
            return
        if not fence.compiles_here():
            super().materialize(key=key, args=args, arg_features=arg_features)
            return
        with LOCK, frontend.patched_frontend():
            if key is None or key not in self.compiled_kernels:  # another thread may have created it meanwhile
                ast_recorder.materialize(self, key, args, arg_features)


def install() -> None:
    """Patch this project's kernels, those that exist and those to come. Do nothing if the patches are off."""
    if not fence.enabled():
        return
    kernel_impl._kernel_impl = _create
    kernel_impl._inside_class = _inside_class
    for kernel in impl.get_runtime().kernels:
        _adopt(kernel)
    memcpy.install()
    tracebacks.install()


def _adopt(kernel: Any) -> None:
    if type(kernel) is Kernel and kernel.autodiff_mode == AutodiffMode.NONE and fence.is_inside(kernel.func.__module__):
        kernel.__class__ = PatchedKernel


def _create(function: Any, level_of_class_stackframe: int, verbose: bool = False) -> Any:
    """Replace `kernel_impl._kernel_impl`."""
    wrapped = _create_kernel(function, level_of_class_stackframe + 1, verbose)
    _adopt(wrapped._primal)
    return wrapped


def _inside_class(level_of_class_stackframe: int) -> bool:
    """Replace `kernel_impl._inside_class`: return whether a decorator, n - 1 frames up, is used in a class body."""
    frame = sys._getframe(level_of_class_stackframe - 1)
    if fence.is_inside(frame.f_globals.get("__name__")):
        return "__qualname__" in frame.f_locals
    return bool(_is_inside_class(level_of_class_stackframe + 1))
