"""A stage that another process reads while kernels are compiled is the same; so are its errors."""

import warnings

import numpy as np
import pytest
from pxr import Sdf

from tests.usd.helpers import write
from tiscene import loading
from tiscene.errors import StageError, StageWarning
from tiscene.render.aovs import AOVS
from tiscene.render.rehearsal import rehearsal
from tiscene.usd import apart, read_stage, unsaved

BOX = 'def Cube "Box" (kind = "component")\n{\n}\ndef Volume "Smoke"\n{\n}'


@pytest.fixture
def beside(monkeypatch):
    """As in a process that has not started Taichi yet."""
    monkeypatch.setattr(loading, "_pays", lambda buffers: True)


def load(path):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        stage, _ = loading.load(path, ("instance",), None, untrusted=False)
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
        monkeypatch.setattr(apart, "_PROGRAM", program)
    else:
        monkeypatch.setattr(apart.sys, "executable", str(tmp_path / "gone"))
    path = write(tmp_path, BOX)
    assert_same(load(path)[0], path)


def test_what_is_not_saved_is_read_here_and_what_needs_few_kernels(tmp_path, monkeypatch):
    monkeypatch.setattr(loading.device, "running", lambda: None)
    monkeypatch.setattr(loading.os, "sched_getaffinity", lambda _: {0, 1}, raising=False)
    path = write(tmp_path, BOX)
    assert loading._pays(("depth", "rgb"))
    assert not loading._pays(("depth", "instance"))
    layer = Sdf.Layer.FindOrOpen(str(path))
    layer.documentation = "changed"
    assert unsaved()
    assert not loading._pays(("depth", "rgb"))


@pytest.mark.parametrize("buffers", [("rgb", "depth"), tuple(AOVS)], ids=["few", "all"])
def test_a_rehearsal_goes_on_to_its_end(buffers):
    assert len(list(rehearsal(buffers))) == 3
