# SPDX-License-Identifier: Apache-2.0
"""Kernels read in the quick way are those that Taichi reads: it finds them in its cache under the same names."""

import os
import subprocess
import sys

import pytest
import taichi as ti

from tiscene.device.taichi_patches import frontend

CODE = """
import sys
from taichi.lang import kernel_impl
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext
places = {
    kernel_impl: ("_inside_class", "_get_tree_and_ctx", "transform_tree"),
    kernel_impl.Kernel: ("materialize",),
    ASTTransformerContext: ("get_pos_info",),
}
own = {(place, name): getattr(place, name) for place, names in places.items() for name in names}
from tiscene.device import front_end
assert all(getattr(*where) is not function for where, function in own.items())
if sys.argv[1] == "again":
    front_end._walk = None  # nothing is read again
if sys.argv[1] == "own":
    for where, function in own.items():
        setattr(*where, function)
import tiscene as ts
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
def test_the_kernels_are_taichi_s_own(tmp_path):
    def cached(way):
        environment = os.environ | {"TI_OFFLINE_CACHE_FILE_PATH": str(tmp_path)}
        done = subprocess.run([sys.executable, "-c", CODE, way], capture_output=True, text=True, env=environment)
        assert done.returncode == 0, done.stderr
        return done.stdout, {path.name for path in tmp_path.glob("*.tic")}

    quick, again, own = cached("quick"), cached("again"), cached("own")
    assert len(quick[1]) > 10
    assert quick == again == own


def test_a_function_within_itself_has_a_tree_of_its_own():
    values = ti.ndarray(ti.f32, 2)
    values[0], values[1] = 3.0, 5.0
    powers(values)
    assert values.to_numpy().tolist() == [81.0, 40.0]


def test_a_tree_serves_all_calls_of_a_function(monkeypatch, tmp_path):
    monkeypatch.setattr(ti.cfg, "offline_cache_file_path", str(tmp_path))  # where nothing is kept of it yet
    lines, parsed = [], frontend._parsed
    monkeypatch.setattr(frontend, "_parsed", lambda source: lines.append(source[1]) or parsed(source))
    often(ti.ndarray(ti.f32, 1))
    assert lines.count("def thrice(x):") == 1


def test_errors_say_where():
    with pytest.raises(ti.TaichiCompilationError) as caught:
        wrong(ti.ndarray(ti.f32, 2))
    assert f'File "{__file__}", line {wrong._primal.func.__code__.co_firstlineno + 3}, in wrong' in str(caught.value)
    assert "    values[1] = nothing(values[0])  # noqa: F821\n                ^^^^^^^\n" in str(caught.value)


def test_a_class_is_told_from_a_module():
    def body(level=2):
        return frontend._inside_class(level + 1)

    class Inside:
        found = body()

    assert Inside.found
    assert not body()
