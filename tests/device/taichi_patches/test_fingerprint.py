# SPDX-License-Identifier: Apache-2.0
"""A fingerprint is the same in another process, and differs where anything that a kernel depends on does."""

import enum
import importlib
import os
import random
import subprocess
import sys
import textwrap
import time
import types
from typing import NamedTuple

import numpy as np
import pytest
import taichi as ti

from tiscene.device import runtime
from tiscene.device.taichi_patches.fingerprint import NoFingerprint, fingerprint, source_digest
from tiscene.device.vector_mode import vector_mode


class Size(enum.Enum):
    SMALL = 1


class Pair(NamedTuple):
    first: object
    second: object


FACTOR = 2.0
TABLE = np.array([1.0, 2.0])
SIZES = {"small": Size.SMALL, "large": (1, 2.5, np.float32(3.0), ti.f32)}
UP = ti.Vector([0.0, 1.0, 0.0])
values1 = ti.types.ndarray(ti.f32, 1)


def largest():
    return max(TABLE)


@ti.func
def scaled(x):
    return x * FACTOR


@ti.func
def deep(x):
    return scaled(x)


@ti.kernel
def kernel(values: values1, times: ti.template()):
    for _ in ti.static(range(times)):
        pair = ti.static(Pair(values, largest()))
        pair.first[0] = deep(scaled(values[0])) + pair.second + UP[1] + ti.static(len(SIZES))


@ti.kernel
def with_a_field(values: values1):
    values[0] = field[0]  # noqa: F821


def taken(made=kernel, times=2):
    runtime.start()
    array = ti.ndarray(ti.f32, 3)
    args = (array, times)[: len(made._primal.arguments)]
    return fingerprint(made._primal, args, made._primal.mapper.lookup(args)[1])


def test_fingerprint_repeats():
    first, second = taken(), taken()
    assert first.text == second.text
    assert first.modules == {__name__}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("FACTOR", 2),
        ("TABLE", np.array([1.0, 3.0])),
        ("UP", ti.Vector([0.0, 2.0, 0.0])),
        ("SIZES", SIZES | {"small": 1}),
        ("SIZES", {**SIZES, "large": (1, 2.5, np.float64(3.0), ti.f32)}),
        ("SIZES", {**SIZES, "large": (1, 2.5, np.float32(3.0), ti.f64)}),
        ("largest", lambda: 1.0),
        ("scaled", deep),
        ("Pair", Size),
    ],
)
def test_fingerprint_changes_with_named_values_and_functions(name, value, monkeypatch):
    before = taken().text
    monkeypatch.setitem(globals(), name, value)
    assert taken().text != before


def constants(**values):
    module = types.ModuleType("constants")
    vars(module).update(values)
    return module


def kernel_with(module):
    @ti.kernel
    def closed(values: values1):
        values[0] = module.LIMIT

    return closed


def test_members_of_a_module_in_a_closure_count():
    assert taken(kernel_with(constants(LIMIT=1.0))).text == taken(kernel_with(constants(LIMIT=1.0, OTHER=2.0))).text
    assert taken(kernel_with(constants(LIMIT=1.0))).text != taken(kernel_with(constants(LIMIT=2.0))).text


@pytest.mark.parametrize("contained", [lambda m: (m,), lambda m: {"m": [m]}, lambda m: Pair(m, 1)])
def test_module_in_a_container_has_no_fingerprint(contained, monkeypatch):
    monkeypatch.setitem(globals(), "field", contained(constants(LIMIT=1.0)))
    with pytest.raises(NoFingerprint, match="constants"):
        taken(with_a_field)
    monkeypatch.setitem(globals(), "field", contained(np))
    assert taken(with_a_field).text


def test_fingerprint_changes_with_template_arguments_and_their_types():
    assert len({taken(times=1).text, taken(times=2).text, taken(times=True).text}) == 3


def test_fingerprint_changes_with_taichi_configuration():
    before = taken().text
    with vector_mode():
        assert taken().text != before


def test_fingerprint_changes_with_the_source_file(tmp_path, monkeypatch):
    source = "import taichi as ti\n@ti.kernel\ndef total(values: ti.types.ndarray(ti.f32, 1)):\n    values[0] = 1.0\n"
    file = tmp_path / "changing_source.py"
    file.write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    module = importlib.import_module("changing_source")
    before = taken(module.total)
    assert before.is_current()
    file.write_text(source + "# changed\n")
    assert not before.is_current()
    assert taken(module.total).text == before.text, "the source that was read first is the kernel's"
    source_digest.cache_clear()
    try:
        assert taken(module.total).text != before.text
    finally:
        source_digest.cache_clear()


@pytest.mark.parametrize("value", [object(), sys.stderr, iter(()), time.time, random.random, os.getenv, None])
def test_value_that_may_differ_elsewhere_has_no_fingerprint(value, monkeypatch):
    monkeypatch.setitem(globals(), "field", value)
    if value is None:
        assert taken(with_a_field).text
    else:
        with pytest.raises(NoFingerprint):
            taken(with_a_field)


def test_functions_of_one_name_have_different_fingerprints():
    def make(factor):
        @ti.func
        def same(x):
            return x * factor

        @ti.kernel
        def kernel(values: values1):
            values[0] = same(values[0])

        return kernel

    assert taken(make(1.0)).text == taken(make(1.0)).text != taken(make(2.0)).text


def test_fingerprint_is_the_same_in_another_process(tmp_path):
    (tmp_path / "sources.py").write_text(
        textwrap.dedent("""
            import taichi as ti
            from tiscene.device import runtime
            from tiscene.device.taichi_patches.fingerprint import fingerprint
            NAMES = {"b": 1, "a": 2}
            class Sum:
                def __init__(self, x): self.x = x
                @staticmethod
                def of(a, b): return a + b
            @ti.kernel
            def total(values: ti.types.ndarray(ti.f32, 1)):
                values[0] = Sum.of(values[0], ti.static(NAMES["a"]))
            runtime.start()
            args = (ti.ndarray(ti.f32, 3),)
            print(fingerprint(total._primal, args, total._primal.mapper.lookup(args)[1]).text)
        """)
    )

    def text(seed):
        command = [sys.executable, "-c", "import sources"]
        environment = os.environ | {"PYTHONHASHSEED": seed, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
        return subprocess.run(command, capture_output=True, text=True, env=environment, check=True).stdout

    assert text("1") == text("2") != ""
