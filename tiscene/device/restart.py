# SPDX-License-Identifier: Apache-2.0
"""Notice that Taichi was restarted, which destroys all arrays of the process.

``ti.init()`` and ``ti.reset()`` free the memory of every Taichi array, but the Python objects live on. Using one of
them crashes the process, and deleting one may free a newer array at the same address. Here a listener in Taichi's
list of kernels, all of which are reset at a restart, keeps the destroyed arrays, so that they can be recognized and are
never deleted.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from functools import lru_cache
from typing import Any, TypeVar

from taichi.lang import impl
from taichi.lang._ndarray import Ndarray

from tiscene.errors import DeviceError

_Function = TypeVar("_Function", bound=Callable[..., Any])

_destroyed: dict[int, Any] = {}  # arrays by id
_caches: list[Any] = []


class RestartListener:
    """Stands in Taichi's list of kernels.

    Attributes:
        compiled_kernels: Always empty; Taichi counts and clears those of all entries.
    """

    def __init__(self) -> None:
        self.compiled_kernels: dict[Any, Any] = {}

    def reset(self) -> None:
        """Collect the arrays that a restart has destroyed. Taichi calls this."""
        for cached in _caches:
            cached.cache_clear()
        _destroyed.update((id(each), each) for each in gc.get_objects() if issubclass(type(each), Ndarray))


_listener = RestartListener()


def watch() -> None:
    """Begin to listen for restarts, if that was not done before."""
    kernels = impl.get_runtime().kernels
    if not any(each is _listener for each in kernels):
        kernels.append(_listener)


def check_array(array: Any) -> None:
    """Raise DeviceError if an array was destroyed by a restart. Any other value passes."""
    if id(array) in _destroyed:
        raise destroyed_error()


def destroyed_error() -> DeviceError:
    """Return the error for the use of arrays that a restart has destroyed."""
    return DeviceError(
        "Taichi was restarted in this process, by ti.init() or ti.reset(), which destroyed the arrays of this stream. "
        "Call ti.init(fast_math=False, ...) before the first Stream, or not at all: once a Stream exists, Taichi runs, "
        "and your own kernels can use it. To continue here, make a new Stream (see docs/taichi.md)"
    )


def cached_on_device(maxsize: int) -> Callable[[_Function], _Function]:
    """Return a decorator for functions that return Taichi arrays: `functools.lru_cache`, emptied at a restart."""

    def decorate(function: _Function) -> _Function:
        cached = lru_cache(maxsize)(function)
        _caches.append(cached)
        return cached  # type: ignore[return-value]

    return decorate
