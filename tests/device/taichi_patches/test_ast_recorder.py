# SPDX-License-Identifier: Apache-2.0
"""A recording makes the kernel that was recorded; a stale or damaged one is not used."""

import os
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
import taichi as ti
from taichi._lib import core
from taichi.lang.kernel_impl import Kernel

from tiscene.device.taichi_patches import ast_recorder, recorded_calls, recording_file
from tiscene.device.taichi_patches.recording_file import (
    CallRecording,
    NotRecordable,
    decode,
    encode,
    read_recording,
    write_recording,
)

vec3 = ti.types.vector(3, ti.f32)
values1 = ti.types.ndarray(ti.f32, 1)
vectors1 = ti.types.ndarray(vec3, 1)

RECORDING = CallRecording(["x", 1.5], ["expr_add", "expr_sub", "expr_add"], [1, 0, 2], [3, 4, 70000])


@pytest.fixture
def built(monkeypatch):
    """The names of the kernels whose AST Taichi's front end builds."""
    names, materialize = [], Kernel.materialize

    def counting(self, *args, **kwargs):
        names.append(self.func.__name__)
        materialize(self, *args, **kwargs)

    monkeypatch.setattr(Kernel, "materialize", counting)
    return names


def recordings(folder):
    return sorted(folder.glob("*.calls"))


def kernel_of(scale=2.0):
    """Return a new kernel from the same source."""

    @ti.func
    def clamped(x, most):
        result = x
        if x > most:
            result = most
        return result

    @ti.func
    def inner(values: ti.template(), direction: vec3):
        count, total = 0, 0.0
        while count < values.shape[0]:
            total += clamped(values[count], 3.0) * direction.norm()
            count += 1
        return total, count

    @ti.func
    def middle(values: ti.template(), factor: ti.f32) -> ti.f32:
        total, count = inner(values, vec3(factor, 0.0, 0.0))
        return total / count

    @ti.kernel
    def kernel(values: values1, vectors: vectors1, times: ti.template(), shift: ti.i32) -> ti.i32:
        ti.loop_config(block_dim=32)
        for i in range(vectors.shape[0]):
            v = vectors[i]
            for k in ti.static(range(times)):
                v[k % 3] = middle(values, scale) + v.dot(vec3(1.0, 2.0, k)) + shift
            vectors[i] = ti.select(v > 1e6, vec3(0.0), v)
        total, count = inner(values, vec3(1.0))
        return ti.cast(total, ti.i32) + count * 100

    return kernel


def result(kernel, times=2):
    values, vectors = ti.ndarray(ti.f32, 4), ti.ndarray(vec3, 5)
    values.from_numpy(np.array([1.0, 2.0, 4.0, 8.0], np.float32))
    vectors.from_numpy(np.arange(15, dtype=np.float32).reshape(5, 3))
    return kernel(values, vectors, times, 1), vectors.to_numpy().tobytes()


def test_replayed_kernel_equals_recorded_kernel(folder, built):
    first = result(kernel_of())
    assert built == ["kernel"]
    built.clear()
    assert result(kernel_of()) == first
    assert not built
    assert result(kernel_of(3.0)) != first
    assert result(kernel_of(), times=1) != first
    assert built == ["kernel"] * 2


@pytest.mark.parametrize(
    "damage", [lambda data: data[:-7], lambda data: data[:40] + b"x" + data[41:], lambda data: b""]
)
def test_damaged_recording_is_written_again(damage, folder, built):
    first = result(kernel_of())
    (file,) = recordings(folder)
    whole = file.read_bytes()
    file.write_bytes(damage(whole))
    built.clear()
    assert result(kernel_of()) == first
    assert built == ["kernel"]
    assert file.read_bytes() == whole


@pytest.mark.parametrize(
    "wrong",
    [
        CallRecording([1], ["no_such_function"], [1], [3]),
        CallRecording([], ["expr_add"], [2], [0, 1]),
        CallRecording([], ["Kernel.ast_builder"], [1], [9]),
    ],
)
def test_recording_that_fails_to_replay_is_replaced(wrong, folder, built):
    first = result(kernel_of())
    (file,) = recordings(folder)
    whole = file.read_bytes()
    write_recording(file, wrong)
    built.clear()
    assert result(kernel_of()) == first
    assert built == ["kernel"]
    assert file.read_bytes() == whole


def test_recording_that_fails_to_replay_is_deleted(folder, built, monkeypatch):
    first = result(kernel_of())
    (file,) = recordings(folder)
    write_recording(file, CallRecording([1], ["no_such_function"], [1], [3]))
    monkeypatch.setattr(ast_recorder, "write_recording", lambda path, recording: None)
    assert result(kernel_of()) == first
    assert not recordings(folder)


def test_kernel_runs_without_cache_where_folder_cannot_be_written(folder):
    folder.write_text("in the way")
    result(kernel_of())
    assert folder.is_file()


def test_kernel_with_print_is_not_recorded(folder, capfd):
    @ti.kernel
    def printing(values: values1):
        print(values[0])

    printing(ti.ndarray(ti.f32, 1))
    assert not folder.exists()


def test_kernel_with_real_function_is_not_recorded(folder):
    @ti.real_func
    def double(x: ti.f32) -> ti.f32:
        return 2.0 * x

    @ti.kernel
    def calls(values: values1):
        values[0] = double(values[0])

    values = ti.ndarray(ti.f32, 1)
    values[0] = 3.0
    calls(values)
    assert values[0] == 6.0
    assert not folder.exists()


def test_nothing_is_recorded_without_offline_cache(folder, monkeypatch):
    monkeypatch.setattr(ti.cfg, "offline_cache", False)
    result(kernel_of())
    assert not folder.exists()


def test_nothing_is_recorded_if_a_source_changes_meanwhile(folder, monkeypatch):
    monkeypatch.setattr(ast_recorder.Fingerprint, "is_current", lambda self: False)
    result(kernel_of())
    assert not folder.exists()


def test_recording_restores_the_library_after_success_and_error(folder):
    before = {name: getattr(core, name) for name in recorded_calls.FUNCTIONS}
    methods = {(owner, name): getattr(owner, name) for owner, name in recorded_calls.METHODS}

    @ti.kernel
    def wrong(values: values1):
        values[0] = nothing(values[0])  # noqa: F821

    result(kernel_of())
    with pytest.raises(ti.TaichiCompilationError):
        wrong(ti.ndarray(ti.f32, 1))
    assert all(getattr(core, name) is function for name, function in before.items())
    assert all(getattr(owner, name) is method for (owner, name), method in methods.items())
    assert len(recordings(folder)) == 1


def test_table_of_recorded_functions_is_complete():
    """All functions that return an expression, several, or the factory of types, by their signatures in the library."""
    builders = {
        name
        for name, function in vars(core).items()
        if type(function) is type(len)
        and str(function.__doc__).split("\n")[0].endswith((".Expr", ".Expr]", ".TypeFactory"))
    }
    assert set(recorded_calls.FUNCTIONS) == builders


@pytest.mark.parametrize(
    "value", [None, True, 3, -1.5, float("inf"), "text", (1, [2.0, "x"]), ti.f32, core.BoundaryMode.UNSAFE]
)
def test_decode_returns_what_was_encoded(value):
    decoded = decode(encode(value))
    assert decoded == value
    assert type(decoded) is type(value)


def test_unknown_type_is_not_recordable():
    with pytest.raises(NotRecordable, match="cannot be recorded"):
        encode(object())


def test_least_recently_used_recordings_are_deleted(tmp_path, monkeypatch):
    monkeypatch.setattr(recording_file, "MAX_FILES", 2)
    for k, name in enumerate("abc"):
        path = tmp_path / f"{name}.calls"
        write_recording(path, RECORDING)
        os.utime(path, (k, k))
        if name == "b":
            assert read_recording(tmp_path / "a.calls") == RECORDING
    assert {path.stem for path in tmp_path.glob("*.calls")} == {"a", "c"}


def test_unfinished_files_of_killed_processes_are_deleted(tmp_path):
    (tmp_path / ".b.calls.1.part").write_bytes(b"half")
    write_recording(tmp_path / "a.calls", RECORDING)
    assert {path.name for path in tmp_path.iterdir()} == {"a.calls", recording_file.LOCK}


@pytest.mark.parametrize("content", [b"", b"[]\n", b'[[], ["a"], 2]\n\0\0\0\0\1\0\0\0', b"\xff\n"])
def test_file_without_a_recording_is_not_read(content, tmp_path):
    (tmp_path / "a.calls").write_bytes(zlib.compress(content))
    assert read_recording(tmp_path / "a.calls") is None


PROGRAM = """
import taichi as ti
from tiscene.device import runtime
from tiscene.device.taichi_patches import fence
fence.include("kernels")
import kernels
runtime.start(threads=1)
print(kernels.total())
"""
KERNELS = """
import taichi as ti
{functions}
def total():
    values = ti.ndarray(ti.f32, 8)
    values.fill(1.5)
    return sum(each(values, k) for k, each in enumerate(EVERY))
"""
FUNCTION = """
@ti.kernel
def kernel_{k}(values: ti.types.ndarray(ti.f32, 1), add: ti.i32) -> ti.i32:
    total = 0.0
    for i in range(values.shape[0]):
        total += ti.sin(values[i]) * {k} + add
    return ti.cast(100 * total, ti.i32)
"""


def test_two_processes_share_one_cold_cache(tmp_path):
    functions = (
        "".join(FUNCTION.format(k=k) for k in range(12)) + "EVERY = [" + "".join(f"kernel_{k}, " for k in range(12))
    )
    (tmp_path / "kernels.py").write_text(KERNELS.format(functions=functions + "]"))
    path = os.pathsep.join([str(tmp_path), str(Path(__file__).parents[3])])
    environment = os.environ | {"TI_OFFLINE_CACHE_FILE_PATH": str(tmp_path / "cache"), "PYTHONPATH": path}

    def start():
        command = [sys.executable, "-W", "ignore", "-c", PROGRAM]
        return subprocess.Popen(command, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    outputs = [process.communicate() for process in [start(), start()]] + [start().communicate()]
    assert len({out for out, _ in outputs}) == 1, outputs
    assert outputs[0][0]
    folder = tmp_path / "cache" / ast_recorder.FOLDER
    assert len(recordings(folder)) == 12
    assert all(read_recording(file) for file in recordings(folder))
    assert not list(folder.glob("*.part"))
