# SPDX-License-Identifier: Apache-2.0
"""A stage that another process reads while kernels are compiled is the same; so are its errors."""

import os
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf

from tests.usd.helpers import preview_material, write
from tiscene.catalog import find_scene
from tiscene.errors import StageError, StageWarning
from tiscene.frame.buffers import BUFFERS
from tiscene.render.render_settings import PRESETS
from tiscene.render.warm_up import warm_up_steps
from tiscene.scene.textures.mipmaps import coarser_copies
from tiscene.stream import loading
from tiscene.usd.read import subprocess_reader
from tiscene.usd.read.stage_reader import read_stage
from tiscene.usd.read.subprocess_reader import has_unsaved_layers

BOX = 'def Cube "Box" (kind = "component") {}\ndef Volume "Smoke" {}'

COMPILED = """
import sys
import tiscene as ts
from tiscene.device.taichi_patches import ast_recorder
from tiscene.stream import loading
warm_up_steps, materialize, told = loading.warm_up_steps, ast_recorder.materialize, []
def whole(*args):
    for each in warm_up_steps(*args):
        pass  # to its end, however soon the stage is read
    print("rehearsed")
    told.append(True)
    yield
def materialized(kernel, *args):
    if told:
        print(kernel.func.__name__)
    materialize(kernel, *args)
loading.warm_up_steps, ast_recorder.materialize = whole, materialized
stream = ts.Stream("room_02", width=32, height=24, quality=sys.argv[1], incremental=False, frames=1)
stream[0]
print("rendered")
"""

STEPS = """
import sys
from tiscene.device import runtime
from tiscene.stream import loading
from tiscene.render.render_settings import PRESETS
from tiscene.catalog import find_scene
from pathlib import Path
warm_up_steps = loading.warm_up_steps
def slow(*args):
    for step, each in enumerate(warm_up_steps(*args)):
        print(step, flush=True)
        yield
    print("end", flush=True)
loading.warm_up_steps = slow
loading.is_worth_a_process = lambda buffers: True
loading.load(Path(sys.argv[1]), ("rgb",), PRESETS["fast"], None, False)
"""


@pytest.fixture
def beside(monkeypatch):
    """As in a process that has not started Taichi yet."""
    monkeypatch.setattr(loading, "is_worth_a_process", lambda buffers: True)


def load(path):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        stage, _ = loading.load(path, ("instance",), PRESETS["fast"], None, untrusted=False)
    return stage, [str(each.message) for each in caught if each.category is StageWarning]


def assert_same(stage, path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StageWarning)
        here = read_stage(path)
    assert (stage.name, stage.objects) == (here.name, here.objects)
    np.testing.assert_array_equal(stage.meshes[0].positions, here.meshes[0].positions)
    assert stage.meshes[0].positions.flags.aligned
    assert stage.meshes[0].positions.flags.writeable


def test_it_is_the_same_with_its_warnings(tmp_path, beside):
    path = write(tmp_path, BOX)
    stage, said = load(path)
    assert_same(stage, path)
    (warning,) = said
    assert "prims of type Volume are not drawn: </Smoke>" in warning


def test_its_errors_are_those_of_reading_here(tmp_path, beside):
    path = write(tmp_path, 'def Mesh "M"\n{\nint[] faceVertexCounts = [3]\n}')
    with pytest.raises(StageError) as here:
        read_stage(path)
    with pytest.raises(StageError) as there:
        load(path)
    assert (there.value.stage, there.value.problems) == (here.value.stage, here.value.problems)


@pytest.mark.parametrize("program", ["raise SystemExit(3)", None])
def test_where_no_other_process_can_it_is_read_here(program, tmp_path, beside, monkeypatch):
    if program:
        monkeypatch.setattr(subprocess_reader, "WORKER_PROGRAM", program)
    else:
        monkeypatch.setattr(subprocess_reader.sys, "executable", str(tmp_path / "gone"))
    path = write(tmp_path, BOX)
    assert_same(load(path)[0], path)


def test_what_is_not_saved_is_read_here_and_what_needs_few_kernels(tmp_path, monkeypatch):
    monkeypatch.setattr(loading.runtime, "running", lambda: None)
    monkeypatch.setattr(loading.os, "sched_getaffinity", lambda _: {0, 1}, raising=False)
    path = write(tmp_path, BOX)
    assert loading.is_worth_a_process(("depth", "rgb"))
    assert not loading.is_worth_a_process(("depth", "instance"))
    layer = Sdf.Layer.FindOrOpen(str(path))
    layer.documentation = "changed"
    assert has_unsaved_layers()
    assert not loading.is_worth_a_process(("depth", "rgb"))


@pytest.mark.parametrize("buffers", [("rgb", "depth"), tuple(BUFFERS)], ids=["few", "all"])
@pytest.mark.parametrize("quality", ["fast", "preview"])
@pytest.mark.parametrize("emission", [False, True])
def test_a_rehearsal_goes_on_to_its_end(buffers, quality, emission):
    assert len(list(warm_up_steps(buffers, PRESETS[quality], lambda: emission))) == 5


@pytest.mark.slow
@pytest.mark.parametrize("quality", ["fast", "preview"])
def test_after_a_rehearsal_a_path_traced_frame_has_nothing_to_compile(quality):
    """The small kernels of incremental rendering are not rehearsed: the stage is read before."""
    done = subprocess.run([sys.executable, "-c", COMPILED, quality], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["rehearsed", "rendered"]


GLOWING = preview_material("/Lamp", "color3f inputs:emissiveColor = (%s, 0, 0)")


@pytest.mark.parametrize(("text", "glows"), [(GLOWING % 2, True), (GLOWING % 0, False), (BOX, False)])
def test_the_other_process_says_first_whether_anything_glows(text, glows, tmp_path):
    with subprocess_reader.SubprocessReader(read_stage, write(tmp_path, text), {}, probe_emission=True) as reading:
        assert reading.has_emission(60.0) == glows


def test_of_a_wrong_stage_it_says_no(tmp_path):
    with subprocess_reader.SubprocessReader(
        read_stage, write(tmp_path, "def Mesh {"), {}, probe_emission=True
    ) as reading:
        assert not reading.has_emission(60.0)
        with pytest.raises(StageError):
            reading.result()


def test_nobody_waits_long_for_it(tmp_path, monkeypatch):
    monkeypatch.setattr(subprocess_reader, "WORKER_PROGRAM", "import time; time.sleep(60)")
    with subprocess_reader.SubprocessReader(read_stage, write(tmp_path, BOX), {}, probe_emission=True) as reading:
        assert not reading.has_emission(0.05)


def test_the_other_process_makes_the_copies_of_textures():
    path = find_scene("room_01")
    with subprocess_reader.SubprocessReader(read_stage, path, {}, probe_emission=True) as reading:
        there = reading.result().textures
    here = read_stage(path).textures
    assert here
    for read, made in zip(here, there, strict=True):
        assert read.copies is None
        assert [copy.pixels.tobytes() for copy in made.copies] == [
            copy.pixels.tobytes() for copy in coarser_copies(read)
        ]
        assert not any(copy.copies for copy in made.copies)
    assert any(each.copies for each in there)


@pytest.fixture
def waiting(tmp_path):
    """A process that loads a stage, about to: what it says of its steps, and the folder of its files."""
    (tmp_path / "files").mkdir()
    environment = os.environ | {"TMPDIR": str(tmp_path / "files")}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    command = [sys.executable, "-c", STEPS, str(find_scene("room_01"))]
    with subprocess.Popen(command, env=environment, start_new_session=True, **pipes) as process:
        yield process, tmp_path / "files"
        process.kill()


def children(process):
    return Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="no list of a process's children here")
@pytest.mark.parametrize("step", ["0", "1"])
def test_ctrl_c_ends_both_processes_and_leaves_nothing(step, waiting):
    process, files = waiting
    for line in process.stdout:
        if line.strip() == step:
            break
    (child,) = children(process)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == -signal.SIGINT, said
    # It may come where pathlib handles an exception: then the traceback has two parts.
    chained = said.count("During handling of the above exception")
    assert said.count("Traceback") - chained == said.count("KeyboardInterrupt\n") == 1
    assert said.endswith("KeyboardInterrupt\n")
    assert not Path("/proc", child).exists()
    assert not list(files.iterdir())


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="no list of a process's children here")
def test_the_other_process_clears_up_after_one_that_was_killed(waiting):
    process, files = waiting
    process.stdout.readline()
    (child,) = children(process)
    process.kill()
    process.wait()
    end = time.monotonic() + 60
    while Path("/proc", child).exists() and time.monotonic() < end:
        time.sleep(0.05)
    assert not Path("/proc", child).exists()
    assert not list(files.iterdir())
