# SPDX-License-Identifier: Apache-2.0
"""Copies between the memory of a CUDA card and that of the host, by the driver that Taichi uses.

Taichi 1.7.4 copies by a kernel, for which it allocates memory on the card and frees it: 0.2 ms for any size. The driver
itself takes about 0.02 ms for an image of 256x192. Copies wait for the kernels launched before, as Taichi's do: both
use the default stream.
"""

from __future__ import annotations

import ctypes
import functools
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import DeviceError

_LIBRARY = "nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1"


@functools.cache
def driver() -> CudaDriver | None:
    """Return the driver, None if there is none."""
    try:
        return CudaDriver(ctypes.CDLL(_LIBRARY))
    except OSError:
        return None


class CudaDriver:
    """The driver's copies, from any thread.

    Args:
        library: The driver.
    """

    def __init__(self, library: Any) -> None:
        self._library = library
        self._context = ctypes.c_void_p()

    def reads(self, address: int, values: NDArray[Any]) -> bool:
        """Return whether an address of the card holds these values."""
        found = np.zeros_like(values)  # not `empty`: freed memory may hold them
        try:
            self.read(address, found)
        except DeviceError:
            return False
        return np.array_equal(found, values)

    def read(self, address: int, target: NDArray[Any]) -> None:
        """Copy from the card into a contiguous array."""
        self._call("cuMemcpyDtoH_v2", ctypes.c_void_p(target.ctypes.data), ctypes.c_uint64(address), target.nbytes)

    def write(self, address: int, source: NDArray[Any]) -> None:
        """Copy a contiguous array to the card."""
        self._call("cuMemcpyHtoD_v2", ctypes.c_uint64(address), ctypes.c_void_p(source.ctypes.data), source.nbytes)

    def copy(self, source: int, target: int, size: int) -> None:
        """Copy bytes from one address of the card to another."""
        self._call("cuMemcpyDtoD_v2", ctypes.c_uint64(target), ctypes.c_uint64(source), size)

    def _call(self, name: str, first: Any, second: Any, size: int) -> None:
        if not size:
            return
        self._enter_context()
        code = getattr(self._library, name)(first, second, ctypes.c_size_t(size))
        if code:
            raise DeviceError(f"the CUDA driver cannot copy {size} bytes: {name} failed with error {code}")

    def _enter_context(self) -> None:
        """Make Taichi's context that of this thread, if it has none, as a thread that has launched no kernel."""
        present = ctypes.c_void_p()
        self._library.cuCtxGetCurrent(ctypes.byref(present))
        if present.value:
            self._context = present
            return
        if not self._context.value:
            self._library.cuDevicePrimaryCtxRetain(ctypes.byref(self._context), ctypes.c_int(0))
        self._library.cuCtxSetCurrent(self._context)
