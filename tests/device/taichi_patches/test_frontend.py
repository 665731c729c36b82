# SPDX-License-Identifier: Apache-2.0
"""Recorded kernels are Taichi's own: before they are simplified, they have the same entries in Taichi's cache."""

import ast
import os
import subprocess
import sys

import pytest
import taichi as ti
from taichi.lang import kernel_impl

from tiscene.device.taichi_patches import fence

PROGRAM = """
import sys
from taichi.lang.kernel_impl import Kernel
import tiscene as ts
import tiscene.device.runtime
if sys.argv[1] == "replayed":
    from tiscene.device.taichi_patches.patched_kernel import PatchedKernel
    materialize = Kernel.materialize
    def refuse(self, *args, **kwargs):
        assert not isinstance(self, PatchedKernel), f"{self.func} was not replayed"
        materialize(self, *args, **kwargs)
    Kernel.materialize = refuse
if sys.argv[1] == "whole":
    from tiscene.device.taichi_patches import ast_recorder
    ast_recorder.simplified = lambda rows, types: rows
print(ts.Stream("object_view", width=16, height=12, quality="fast", incremental=False)[0].rgb.mean())
"""


@ti.func
def twice(x):
    return x + x


@ti.func
def power(x, exponent: ti.template()):
    result = x
    if ti.static(exponent > 1):
        result = x * power(x, exponent - 1) + twice(0.0)
    return result


@ti.kernel
def powers(values: ti.types.ndarray(ti.f32, 1)):
    values[0] = power(values[0], 4)
    values[1] = twice(twice(values[1])) + twice(values[1] * twice(1.0))


@ti.func
def thrice(x):
    return 3.0 * x


@ti.kernel
def often(values: ti.types.ndarray(ti.f32, 1)):
    for _ in ti.static(range(5)):
        values[0] = thrice(thrice(values[0])) + thrice(1.0)


@ti.kernel
def wrong(values: ti.types.ndarray(ti.f32, 1)):
    values[0] = twice(values[0])
    values[1] = nothing(values[0])  # noqa: F821


@pytest.mark.slow
def test_all_ways_produce_the_same_cache_entries(tmp_path):
    def compiled(way, folder, switch="1"):
        environment = os.environ | {"TI_OFFLINE_CACHE_FILE_PATH": str(tmp_path / folder), fence.SWITCH: switch}
        done = subprocess.run([sys.executable, "-c", PROGRAM, way], capture_output=True, text=True, env=environment)
        assert done.returncode == 0, done.stderr
        return done.stdout, {path.name for path in (tmp_path / folder).glob("*.tic")}

    recorded, replayed = compiled("recorded", "simplified"), compiled("replayed", "simplified")
    whole, own = compiled("whole", "whole"), compiled("own", "own", switch="0")
    assert len(recorded[1]) > 10
    assert recorded == replayed
    assert recorded[0] == whole[0] == own[0]
    assert whole[1] <= own[1], "with the patches off there are Taichi's kernels that copy arrays too"


def test_recursive_function_is_compiled_right():
    values = ti.ndarray(ti.f32, 2)
    values[0], values[1] = 3.0, 5.0
    powers(values)
    assert values.to_numpy().tolist() == [81.0, 40.0]


def test_function_is_parsed_once_for_all_calls(monkeypatch, tmp_path):
    monkeypatch.setattr(ti.cfg, "offline_cache_file_path", str(tmp_path))  # has no recordings
    sources, parse = [], ast.parse
    monkeypatch.setattr(ast, "parse", lambda source, *args: sources.append(source) or parse(source, *args))
    often(ti.ndarray(ti.f32, 1))
    assert sum("def thrice(x):" in source for source in sources) == 1


def test_compilation_error_names_file_line_and_expression():
    with pytest.raises(ti.TaichiCompilationError) as caught:
        wrong(ti.ndarray(ti.f32, 2))
    assert f'File "{__file__}", line {wrong._primal.func.__code__.co_firstlineno + 3}, in wrong' in str(caught.value)
    assert "    values[1] = nothing(values[0])  # noqa: F821\n                ^^^^^^^\n" in str(caught.value)


def test_decorator_in_a_class_is_recognized():
    @ti.data_oriented
    class Owner:
        @ti.kernel
        def inside(self) -> ti.i32:
            return 3

    @ti.kernel
    def outside() -> ti.i32:
        return 4

    assert Owner().inside() == 3
    assert outside() == 4
    assert kernel_impl.Kernel.__call__(outside._primal) == 4
