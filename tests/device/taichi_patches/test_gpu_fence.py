# SPDX-License-Identifier: Apache-2.0
"""On a GPU, kernels are compiled by Taichi's own front end, unless the environment says otherwise."""

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
def test_front_end_on_a_gpu_is_not_patched(switch: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    taichi = SimpleNamespace(cfg=SimpleNamespace(arch=ti.cuda), x64=ti.x64, arm64=ti.arm64)
    monkeypatch.setattr(fence, "ti", taichi)
    monkeypatch.delenv(fence.SWITCH, raising=False)
    if switch:
        monkeypatch.setenv(fence.SWITCH, switch)
    assert fence.compiles_here() is (switch == "1")


def test_kernel_is_compiled_by_taichi_but_launched_directly_where_the_front_end_is_off(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(*_args: object) -> None:
        raise AssertionError("patched")

    with monkeypatch.context() as patch:
        patch.setattr(fence, "compiles_here", lambda: False)
        patch.setattr(ast_recorder, "materialize", refuse)
        values = np.arange(5, dtype=np.int32)
        for _ in range(3):
            double(values)
        assert values.tolist() == [0, 8, 16, 24, 32]
        assert double._primal.launch_plan.variants
