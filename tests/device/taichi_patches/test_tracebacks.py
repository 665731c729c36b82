# SPDX-License-Identifier: Apache-2.0
"""Arrays of this project are made without the text of the call stack; a user's own arrays keep it."""

import traceback

import numpy as np
import pytest
import taichi as ti

from tiscene.device.memory import device_array


@pytest.mark.parametrize("dtype", [ti.f32, ti.types.vector(3, ti.f32)])
def test_device_arrays_do_not_format_the_stack_and_a_users_arrays_do(monkeypatch, dtype):
    calls = []
    extract = traceback.extract_stack
    monkeypatch.setattr(traceback, "extract_stack", lambda *args: (calls.append(args), extract(*args))[1])
    array = device_array(dtype, 4)
    assert not calls
    assert (array.to_numpy() == np.zeros(array.to_numpy().shape)).all()
    exec("import taichi; taichi.ndarray(dtype, 4)", {"__name__": "user", "dtype": dtype})
    assert calls
