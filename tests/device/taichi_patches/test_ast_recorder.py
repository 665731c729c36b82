# SPDX-License-Identifier: Apache-2.0
"""What was written down of a kernel makes the same kernel; what is not the same any more, or damaged, does not."""

from pathlib import Path

import numpy as np
import pytest
import taichi as ti

from tiscene.device import runtime
from tiscene.device.taichi_patches import ast_recorder, frontend, recording_file
from tiscene.device.taichi_patches.recording_file import NotKept, Tape, decoded, encoded, read_tape, write_tape

vec3 = ti.types.vector(3, ti.f32)
values1 = ti.types.ndarray(ti.f32, 1)
vectors1 = ti.types.ndarray(vec3, 1)

TAPE = Tape(["x", 1.5], ["expr_add", "expr_sub", "expr_add"], [1, 0, 2], [3, 4, 70000])


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Where recordings are for once, and a count of sources that were parsed."""
    runtime.start()
    monkeypatch.setattr(ti.cfg, "offline_cache_file_path", str(tmp_path))
    return tmp_path / ast_recorder.FOLDER


@pytest.fixture
def walked(monkeypatch):
    """The names of functions through which Taichi's front end has gone."""
    names, walk = [], frontend._walk
    monkeypatch.setattr(
        frontend, "_walk", lambda tree, context: names.append(context.func.func.__name__) or walk(tree, context)
    )
    return names


def kernel_of(scale=2.0):
    """A new kernel from the same source."""

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


def test_a_kernel_is_made_again_without_the_front_end(folder, walked):
    first = result(kernel_of())
    assert {"kernel", "middle", "inner", "clamped"} <= set(walked)
    walked.clear()
    assert result(kernel_of()) == first
    assert not walked
    assert result(kernel_of(3.0)) != first
    assert result(kernel_of(), times=1) != first
    assert walked.count("kernel") == 2


@pytest.mark.parametrize("harm", [lambda data: data[:-7], lambda data: data[:40] + b"x" + data[41:], lambda data: b""])
def test_what_is_damaged_is_made_and_written_again(harm, folder, walked):
    first = result(kernel_of())
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    file.write_bytes(harm(whole))
    walked.clear()
    assert result(kernel_of()) == first
    assert "kernel" in walked
    assert file.read_bytes() == whole


def test_a_folder_that_cannot_be_written_to_is_left_alone(folder):
    folder.write_text("in the way")
    result(kernel_of())
    assert folder.is_file()


def test_what_prints_is_left_to_taichi(folder, capfd):
    @ti.kernel
    def says(values: values1):
        print(values[0])

    says(ti.ndarray(ti.f32, 1))
    assert not folder.exists()


def test_what_calls_a_function_that_is_not_inlined_is_left_to_taichi(folder):
    @ti.real_func
    def deep(x: ti.f32) -> ti.f32:
        return 2.0 * x

    @ti.kernel
    def calls(values: values1):
        values[0] = deep(values[0])

    values = ti.ndarray(ti.f32, 1)
    values[0] = 3.0
    calls(values)
    assert values[0] == 6.0
    assert not folder.exists()


def test_nothing_is_kept_without_a_cache(folder, monkeypatch):
    monkeypatch.setattr(ti.cfg, "offline_cache", False)
    result(kernel_of())
    assert not folder.exists()


def test_nothing_is_kept_of_a_source_that_changes_meanwhile(folder, monkeypatch):
    monkeypatch.setattr(ast_recorder.Fingerprint, "is_true", lambda self: False)
    result(kernel_of())
    assert not folder.exists()


def test_taichi_s_library_is_as_it_was(folder):
    before = {name: getattr(ast_recorder.core, name) for name in ast_recorder._FUNCTIONS}
    methods = {(kind, name): getattr(kind, name) for kind, name in ast_recorder._METHODS}

    @ti.kernel
    def wrong(values: values1):
        values[0] = nothing(values[0])  # noqa: F821

    result(kernel_of())
    with pytest.raises(ti.TaichiCompilationError):
        wrong(ti.ndarray(ti.f32, 1))
    assert all(getattr(ast_recorder.core, name) is function for name, function in before.items())
    assert all(getattr(kind, name) is method for (kind, name), method in methods.items())
    assert len(list(folder.iterdir())) == 1


@pytest.mark.parametrize(
    "value", [None, True, 3, -1.5, float("inf"), "text", (1, [2.0, "x"]), ti.f32, ast_recorder.core.BoundaryMode.UNSAFE]
)
def test_values_are_written_down(value):
    back = decoded(encoded(value))
    assert back == value
    assert type(back) is type(value)


def test_what_has_no_words_is_not():
    with pytest.raises(NotKept):
        encoded(object())


def test_those_not_used_for_longest_go(tmp_path, monkeypatch):
    monkeypatch.setattr(recording_file, "MOST", 2)
    for k, name in enumerate("abc"):
        path = tmp_path / f"{name}.calls"
        write_tape(path, TAPE)
        recording_file.os.utime(path, (k, k))
        if name == "b":
            assert read_tape(tmp_path / "a.calls") == TAPE
    assert {path.stem for path in Path(tmp_path).iterdir()} == {"a", "c"}
