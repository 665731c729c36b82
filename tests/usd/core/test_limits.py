# SPDX-License-Identifier: Apache-2.0
"""Files that are not trusted: what they may take, where they may be, and a process of their own."""

from __future__ import annotations

import io
import os
import pickle
import warnings

import numpy as np
import pytest
from PIL import Image

from tests.usd.helpers import QUAD, STAGES, problems_of, write
from tests.usd.lights.test_ies import ies
from tests.usd.materials.test_material import texture
from tiscene.errors import ArgumentError, MissingFile, StageError, StageWarning, UnknownName
from tiscene.usd.core.limits import Limits
from tiscene.usd.read.stage_reader import read_stage
from tiscene.usd.read.subprocess_reader import _ResultReader


def bomb(folder, levels: int):
    """2 to the power of `levels` prims out of a few lines: each level refers to the next one twice."""
    for level in range(levels):
        twice = "".join(f'def "{n}" (references = @l{level + 1}.usda@</A>)\n{{\n}}\n' for n in "XY")
        (folder / f"l{level}.usda").write_text(f'#usda 1.0\ndef Xform "A"\n{{\n{twice}}}\n')
    (folder / f"l{levels}.usda").write_text('#usda 1.0\ndef Cube "A"\n{\n}\n')
    return folder / "l0.usda"


def test_the_number_of_prims_is_limited(tmp_path):
    path = bomb(tmp_path, 6)
    assert len(read_stage(path).instances) == 64
    with pytest.raises(StageError, match="it has more than 100 prims; raise `limits`"):
        read_stage(path, limits=Limits(prims=100))


def test_triangles_and_time_are_limited(tmp_path):
    path = write(tmp_path, f'def Mesh "A"\n{{{QUAD}}}')
    with pytest.raises(StageError, match="it has more than 1 triangles"):
        read_stage(path, limits=Limits(triangles=1))
    with pytest.raises(StageError, match=r"reading it took longer than 1e-09 s"):
        read_stage(path, limits=Limits(seconds=1e-9))
    with pytest.raises(ArgumentError, match="limits: prims=0 must be positive"):
        Limits(prims=0)


def test_layers_stay_inside_the_root(tmp_path):
    (tmp_path / "inside").mkdir()
    write(tmp_path, 'def Cube "A"\n{\n}', name="outside.usda")
    inside = write(tmp_path / "inside", 'def "B" (references = @../outside.usda@</A>)\n{\n}')
    assert len(read_stage(inside).instances) == 1
    assert len(read_stage(inside, root=tmp_path).instances) == 1
    with pytest.raises(StageError, match=r"layer @.*outside.usda@ is outside .*inside$"):
        read_stage(inside, root=tmp_path / "inside")
    os.symlink(tmp_path / "outside.usda", tmp_path / "inside" / "link.usda")
    linked = write(tmp_path / "inside", 'def "B" (references = @link.usda@</A>)\n{\n}', name="linked.usda")
    with pytest.raises(StageError, match="is outside"):
        read_stage(linked, root=tmp_path / "inside")
    with pytest.raises(ArgumentError, match="root='gone' is no folder"):
        read_stage(inside, root="gone")


def test_assets_stay_inside_the_root(tmp_path):
    (tmp_path / "inside").mkdir()
    Image.new("RGB", (1, 1)).save(tmp_path / "secret.png")
    (tmp_path / "lamp.ies").write_bytes(ies([0, 90], [0], [[1, 1]]))
    stage = write(tmp_path / "inside", texture("asset inputs:file = @../secret.png@"))
    assert len(read_stage(stage).textures) == 1
    with pytest.raises(StageError, match=r"</Looks/L/Image> texture: @.*secret.png@ is outside"):
        read_stage(stage, root=tmp_path / "inside")
    body = (
        'def RectLight "L" (prepend apiSchemas = ["ShapingAPI"])\n{\nasset inputs:shaping:ies:file = @../lamp.ies@\n}'
    )
    lamp = write(tmp_path / "inside", body, name="lamp.usda")
    with pytest.raises(StageError, match=r"</L> light: @.*lamp.ies@ is outside"):
        read_stage(lamp, root=tmp_path / "inside")


def test_a_process_of_its_own_reads_the_same():
    here = read_stage(STAGES / "instances.usda")
    apart = read_stage(STAGES / "instances.usda", untrusted=True)
    assert apart.objects == here.objects
    for mine, theirs in zip(here.meshes, apart.meshes, strict=True):
        np.testing.assert_array_equal(mine.positions, theirs.positions)
        np.testing.assert_array_equal(mine.triangles, theirs.triangles)
    for mine, theirs in zip(here.instances, apart.instances, strict=True):
        np.testing.assert_array_equal(mine.world_from_object, theirs.world_from_object)


def test_errors_and_warnings_come_through(tmp_path):
    path = write(tmp_path, 'def Volume "V"\n{\n}\ndef Mesh "M"\n{\nint[] faceVertexCounts = [3]\n}')
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StageWarning)
        with pytest.raises(StageError) as caught:
            read_stage(path, untrusted=True)
    assert caught.value.problems == problems_of(tmp_path, path.read_text().split("\n)\n", 1)[1])
    named = write(tmp_path, 'def Volume "V"\n{\n}', name="named.usda")
    with pytest.warns(StageWarning, match="prims of type Volume are not drawn: </V>"):
        read_stage(named, untrusted=True)
    with pytest.raises(MissingFile, match="does not exist"):
        read_stage(tmp_path / "gone.usda", untrusted=True)
    with pytest.raises(UnknownName, match="no taxonomy 'x'"):
        read_stage(STAGES / "instances.usda", untrusted=True, taxonomy="x")


def test_a_bomb_is_stopped_by_the_clock(tmp_path):
    with pytest.raises(StageError, match="reading it took longer than 4 s"):
        read_stage(bomb(tmp_path, 22), untrusted=True, limits=Limits(seconds=4.0))


def test_a_bomb_is_stopped_by_its_memory(tmp_path):
    with pytest.raises(StageError, match=r"took more memory than 1 GiB|crashes USD|failed"):
        read_stage(bomb(tmp_path, 22), untrusted=True, limits=Limits(seconds=60.0, memory=1 << 30))


def test_the_other_process_is_not_trusted_either():
    """A pickle may call whatever it names: only what scenes are made of is let through."""
    good = pickle.dumps(read_stage(STAGES / "instances.usda"))
    assert _ResultReader(io.BytesIO(good)).load().name == "instances"
    for name in ("os.system", "builtins.eval", "tiscene.scene.description.np", "tiscene.scene.description.dataclass"):
        module, _, attribute = name.rpartition(".")
        with pytest.raises(pickle.UnpicklingError, match="is no part of a scene"):
            _ResultReader(io.BytesIO(f"c{module}\n{attribute}\n.".encode())).load()
