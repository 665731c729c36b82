# SPDX-License-Identifier: Apache-2.0
"""On a GPU, kernels are compiled and launched by Taichi's own code, unless the environment says otherwise."""

from types import SimpleNamespace

import numpy as np
import pytest
import taichi as ti

from tiscene.device.kernel_types import Ints1
from tiscene.device.taichi_patches import ast_recorder, fence


@ti.kernel
def double(values: Ints1):
    for i in range(values.shape[0]):
        values[i] *= 2


@pytest.mark.parametrize("switch", [None, "1"])
def test_kernels_on_a_gpu_are_not_patched(switch: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    taichi = SimpleNamespace(cfg=SimpleNamespace(arch=ti.cuda), x64=ti.x64, arm64=ti.arm64)
    monkeypatch.setattr(fence, "ti", taichi)
    monkeypatch.delenv(fence.SWITCH, raising=False)
    if switch:
        monkeypatch.setenv(fence.SWITCH, switch)
    assert fence.on_this_device() is (switch == "1")


def test_kernel_runs_by_taichis_own_code_where_patches_are_off(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_args: object) -> None:
        raise AssertionError("patched")

    with monkeypatch.context() as patch:
        patch.setattr(fence, "on_this_device", lambda: False)
        patch.setattr(ast_recorder, "materialize", refuse)
        values = np.arange(5, dtype=np.int32)
        for _ in range(3):
            double(values)
        assert values.tolist() == [0, 8, 16, 24, 32]
        assert not double._primal.launch_plan.supported
    double._primal.launch_plan = None
    double(values)
    double(values)
    assert double._primal.launch_plan.variants
    assert values.tolist() == [0, 32, 64, 96, 128]
