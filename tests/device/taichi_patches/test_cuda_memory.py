# SPDX-License-Identifier: Apache-2.0
"""Copies by the CUDA driver, with a driver whose card is the memory of the host."""

import ctypes
from types import SimpleNamespace

import numpy as np
import pytest
import taichi as ti

from tiscene.device import memory
from tiscene.device.taichi_patches import cuda_memory, memcpy
from tiscene.errors import DeviceError


class HostAsCard:
    """The functions of a driver that `CudaDriver` calls.

    Attributes:
        entered: Contexts that threads entered.
        code: What copies return.
    """

    def __init__(self, current: int = 0) -> None:
        self.current, self.entered, self.code = current, [], 0
        self.cuMemcpyDtoH_v2 = self.cuMemcpyHtoD_v2 = self.cuMemcpyDtoD_v2 = self._copy

    def _copy(self, target, source, size) -> int:
        if not self.code:
            ctypes.memmove(target.value, source.value, size.value)
        return self.code

    def cuCtxGetCurrent(self, context) -> int:
        context._obj.value = self.current
        return 0

    def cuDevicePrimaryCtxRetain(self, context, device) -> int:
        context._obj.value = 77 + device.value
        return 0

    def cuCtxSetCurrent(self, context) -> int:
        self.entered.append(context.value)
        self.current = context.value
        return 0


@pytest.fixture
def card(monkeypatch: pytest.MonkeyPatch) -> HostAsCard:
    """A driver, which arrays are copied by."""
    library = HostAsCard(current=5)
    driver = cuda_memory.CudaDriver(library)
    monkeypatch.setattr(memcpy, "is_shared", lambda: False)
    monkeypatch.setattr(memcpy, "is_direct", lambda: True)
    monkeypatch.setattr(cuda_memory, "driver", lambda: driver)
    return library


@pytest.mark.parametrize("kind", [ti.f32, ti.i32, ti.u8, ti.types.vector(3, ti.f32)])
def test_arrays_return_what_was_written(card, kind):
    array = memory.device_array(kind, (4, 5))
    shape = (4, 5, 3) if kind not in (ti.f32, ti.i32, ti.u8) else (4, 5)
    values = np.arange(np.prod(shape)).reshape(shape)
    memcpy.write(array, np.asfortranarray(values))  # converted, and in another order
    assert (memcpy.read(array) == values).all()
    memory.write_rows(array, 1, -values[:2].astype(np.int8) % 100)
    expected = np.concatenate([values[:1], -values[:2].astype(np.int8) % 100, values[3:]])
    assert (memcpy.read(array) == expected).all()
    other = memory.device_array(kind, (6, 5))
    memory.copy_rows(array, other, 3)
    assert (memcpy.read(other) == np.concatenate([expected[:3], np.zeros_like(values[:3])])).all()


def test_rows_beyond_the_end_and_other_shapes_are_refused(card):
    array = memory.device_array(ti.f32, (4, 5))
    with pytest.raises(ValueError, match="rows 3 to 5 of an array of 4"):
        memory.write_rows(array, 3, np.zeros((2, 5), np.float32))
    with pytest.raises(ValueError, match="Mismatch shape"):
        memcpy.write(array, np.zeros((5, 4), np.float32))


def test_thread_without_a_context_enters_that_of_the_others(card):
    array = memory.device_array(ti.f32, 3)
    memcpy.write(array, np.ones(3, np.float32))
    assert card.entered == []
    card.current = 0
    assert memcpy.read(array).tolist() == [1.0, 1.0, 1.0]
    assert card.entered == [5]


def test_first_thread_without_a_context_enters_the_primary_one():
    library = HostAsCard()
    values, found = np.arange(3.0), np.empty(3)
    cuda_memory.CudaDriver(library).read(values.ctypes.data, found)
    assert found.tolist() == [0.0, 1.0, 2.0]
    assert library.entered == [77]


def test_errors_of_the_driver_are_reported(card):
    array = memory.device_array(ti.f32, 3)
    card.code = 700
    with pytest.raises(DeviceError, match="cannot copy 12 bytes: cuMemcpyDtoH_v2 failed with error 700"):
        memcpy.read(array)


def test_driver_that_reads_other_values_is_not_used(monkeypatch):
    library = HostAsCard(current=5)
    driver = cuda_memory.CudaDriver(library)
    monkeypatch.setattr(cuda_memory, "driver", lambda: driver)
    assert memcpy._driver_reads.__wrapped__()
    library.code = 1
    assert not memcpy._driver_reads.__wrapped__()
    library.code, library.cuMemcpyDtoH_v2 = 0, lambda *_: 0
    assert not memcpy._driver_reads.__wrapped__()
    monkeypatch.setattr(cuda_memory, "driver", lambda: None)
    assert not memcpy._driver_reads.__wrapped__()


def test_machine_without_the_library_has_no_driver(monkeypatch):
    monkeypatch.setattr(cuda_memory, "ctypes", SimpleNamespace(CDLL=ctypes.CDLL))
    monkeypatch.setattr(cuda_memory, "_LIBRARY", "libthere-is-none.so")
    cuda_memory.driver.cache_clear()
    assert cuda_memory.driver() is None
    cuda_memory.driver.cache_clear()
