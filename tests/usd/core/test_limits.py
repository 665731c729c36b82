# SPDX-License-Identifier: Apache-2.0
"""Limits on reading: prims, triangles, time, memory, folders; and reading in a child process."""

from __future__ import annotations

import io
import os
import pickle
import signal
import time
import warnings

import numpy as np
import pytest
from PIL import Image

from tests.usd.helpers import QUAD, STAGES, problems_of, write
from tests.usd.lights.test_ies import ies
from tests.usd.materials.test_material_textures import texture
from tiscene.errors import ArgumentError, StageError, StageWarning, UnknownName
from tiscene.usd.core.limits import Limits
from tiscene.usd.read.stage_reader import read_stage
from tiscene.usd.read.subprocess_reader import SubprocessReader, load_result, read_in_subprocess
from tiscene.usd.read.template import read_template
from tiscene.usd.scenario.read import read_scenario

posix = pytest.mark.skipif(os.name != "posix", reason="limits of processes need POSIX")


def prim_bomb(folder, levels: int):
    """Write a stage of 2 ** levels prims in a few lines: each level references the next one twice."""
    for level in range(levels):
        twice = "".join(f'def "{n}" (references = @l{level + 1}.usda@</A>) {{}}\n' for n in "XY")
        (folder / f"l{level}.usda").write_text(f'#usda 1.0\ndef Xform "A"\n{{\n{twice}}}\n')
    (folder / f"l{levels}.usda").write_text('#usda 1.0\ndef Cube "A" {}\n')
    return folder / "l0.usda"


def test_more_prims_than_the_limit_are_refused(tmp_path):
    path = prim_bomb(tmp_path, 6)
    assert len(read_stage(path).instances) == 64
    with pytest.raises(StageError, match=r"it has more than 100 prims: .* raise the limit with Limits\(prims=\.\.\.\)"):
        read_stage(path, limits=Limits(prims=100), isolate=False)


def test_more_triangles_or_seconds_than_the_limit_are_refused(tmp_path):
    path = write(tmp_path, f'def Mesh "A"\n{{{QUAD}}}')
    with pytest.raises(StageError, match=r"it has more than 1 triangles.*Limits\(triangles="):
        read_stage(path, limits=Limits(triangles=1), isolate=False)
    with pytest.raises(StageError, match=r"reading it took longer than 1e-09 s.*Limits\(seconds="):
        read_stage(path, limits=Limits(seconds=1e-9), isolate=False)
    with pytest.raises(ArgumentError, match="limits: prims=0 must be positive"):
        Limits(prims=0)


def test_layers_outside_the_root_are_refused(tmp_path):
    (tmp_path / "inside").mkdir()
    write(tmp_path, 'def Cube "A" {}', name="outside.usda")
    inside = write(tmp_path / "inside", 'def "B" (references = @../outside.usda@</A>) {}')
    assert len(read_stage(inside).instances) == 1
    assert len(read_stage(inside, root=tmp_path).instances) == 1
    with pytest.raises(StageError, match=r"layer @.*outside.usda@ is outside .*inside\nroot= "):
        read_stage(inside, root=tmp_path / "inside")
    os.symlink(tmp_path / "outside.usda", tmp_path / "inside" / "link.usda")
    linked = write(tmp_path / "inside", 'def "B" (references = @link.usda@</A>) {}', name="linked.usda")
    with pytest.raises(StageError, match="is outside"):
        read_stage(linked, root=tmp_path / "inside")
    with pytest.raises(ArgumentError, match="root='gone' is not a folder"):
        read_stage(inside, root="gone")


def test_layers_that_are_opened_late_must_be_in_the_root(tmp_path):
    """Those of value clips, once a value is read, and those of a variant that a template selects."""
    inside = tmp_path / "inside"
    inside.mkdir()
    write(tmp_path, 'def Cube "A"\n{\n double size.timeSamples = { 0: 1, 9: 2 }\n}', name="clip.usda")
    write(inside, 'over "A"\n{\n double size\n}', name="manifest.usda")
    clips = """def Cube "B" (clips = {
        dictionary default = {
            asset[] assetPaths = [@../clip.usda@]
            asset manifestAssetPath = @manifest.usda@
            string primPath = "/A"
            double2[] active = [(0, 0)]
        }
    }) {}"""
    with pytest.raises(StageError, match=r"layer @.*clip.usda@ is outside .*inside\nroot= "):
        read_stage(write(inside, clips), root=inside)
    variants = """def Xform "B" (
        variantSets = "shape"
    ) {
        variantSet "shape" = {
            "none" {
            }
            "other" {
                def "C" (references = @../clip.usda@</A>) {}
            }
        }
    }"""
    path = write(inside, variants)
    assert read_template(path, variants={"shape": "other"}).description.instances
    with pytest.raises(StageError, match=r"layer @.*clip.usda@ is outside .*inside\nroot= "):
        read_template(path, variants={"shape": "other"}, root=inside)


def test_assets_outside_the_root_are_refused(tmp_path):
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


def assert_equal(left, right):
    """Compare two scene descriptions: objects, meshes and instances."""
    assert left.objects == right.objects
    for mine, theirs in zip(left.meshes, right.meshes, strict=True):
        np.testing.assert_array_equal(mine.positions, theirs.positions)
        np.testing.assert_array_equal(mine.triangles, theirs.triangles)
    for mine, theirs in zip(left.instances, right.instances, strict=True):
        np.testing.assert_array_equal(mine.world_from_object, theirs.world_from_object)


@pytest.mark.parametrize("options", [{"untrusted": True}, {"limits": Limits()}, {"isolate": True}], ids=str)
def test_reading_in_a_child_process_returns_the_same_scene(options):
    assert_equal(read_stage(STAGES / "instances.usda"), read_stage(STAGES / "instances.usda", **options))


def test_scenarios_and_templates_read_in_a_child_process_are_the_same(tmp_path):
    spin = "float xformOp:rotateY.timeSamples = { 0: 0, 10: 90 }"
    order = 'uniform token[] xformOpOrder = ["xformOp:rotateY"]'
    path = write(tmp_path, f'def Cube "A"\n{{\n{spin}\n{order}\n}}')
    here = read_scenario(path)
    assert [each["id"] for each in here.content["objects"]] == ["A"]
    assert read_scenario(path, limits=Limits()) == here
    here, there = read_template(path), read_template(path, limits=Limits())
    assert (there.name, there.category) == (here.name, here.category)
    assert_equal(there.description, here.description)


def test_errors_and_warnings_of_a_child_process_are_passed_on(tmp_path):
    path = write(tmp_path, 'def Volume "V" {}\ndef Mesh "M"\n{\nint[] faceVertexCounts = [3]\n}')
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StageWarning)
        with pytest.raises(StageError) as caught:
            read_stage(path, untrusted=True)
    assert caught.value.problems == problems_of(tmp_path, path.read_text().split("\n)\n", 1)[1])
    volume = write(tmp_path, 'def Volume "V" {}', name="volume.usda")
    with pytest.warns(StageWarning, match="prims of type Volume are not drawn: </V>") as warned:
        read_stage(volume, untrusted=True)
    assert [each.filename for each in warned] == [__file__]
    with pytest.raises(UnknownName, match="no taxonomy 'x'"):
        read_stage(STAGES / "instances.usda", untrusted=True, taxonomy="x")


def test_untrusted_files_cannot_be_read_in_this_process():
    with pytest.raises(ArgumentError, match="isolate=False: an untrusted file"):
        read_stage(STAGES / "instances.usda", untrusted=True, isolate=False)


def hang(path):
    """Stand for USD on a file that keeps it busy."""
    time.sleep(600)


def exhaust_memory(path):
    """Stand for USD on a file with a huge count."""
    return bytearray(1 << 40)


def crash(path):
    """Stand for USD on a file that it cannot survive."""
    os.kill(os.getpid(), signal.SIGSEGV)


def fail(path):
    """Stand for a bug of the reader."""
    raise KeyError("bug")


@posix
@pytest.mark.parametrize(
    ("function", "message"),
    [
        (hang, r"reading it took longer than 2 s: the file may be damaged; .* Limits\(seconds=\.\.\.\)"),
        (
            exhaust_memory,
            r"reading it took more memory than 4 GiB: the file may .* Limits\(memory=\.\.\.\)",
        ),
        (crash, r"it crashes USD \(signal 11\): the file is damaged or malicious"),
        (fail, "reading it failed: KeyError: 'bug'"),
    ],
)
def test_failures_of_a_child_process_are_stage_errors_with_the_file(function, message):
    start = time.monotonic()
    seconds = 2.0 if function is hang else 60.0
    with pytest.raises(StageError, match=f"room.usdc has 1 problem:\n  {message}") as caught:
        read_in_subprocess(function, "room.usdc", {}, Limits(seconds=seconds, memory=4 << 30))
    assert type(caught.value) is StageError
    assert time.monotonic() - start < 30.0


@posix
@pytest.mark.slow
def test_a_child_process_stops_without_its_parent(tmp_path):
    """The operating system enforces the limits, even if the parent does not wait for the result."""
    with SubprocessReader(hang, "room.usdc", {}, Limits(seconds=0.5)) as reader:
        end = time.monotonic() + 60.0
        while not reader.done() and time.monotonic() < end:
            time.sleep(0.1)
        assert reader.done()
        with pytest.raises(StageError, match=r"longer than 0\.5 s"):
            reader.result()


@pytest.mark.slow
def test_a_prim_bomb_is_stopped_at_the_time_limit(tmp_path):
    with pytest.raises(StageError, match="reading it took longer than 4 s"):
        read_stage(prim_bomb(tmp_path, 22), limits=Limits(seconds=4.0))


def test_a_prim_bomb_is_stopped_at_the_memory_limit(tmp_path):
    with pytest.raises(StageError, match=r"took more memory than 1 GiB|crashes USD|failed|MemoryError"):
        read_stage(prim_bomb(tmp_path, 22), limits=Limits(seconds=60.0, memory=1 << 30))


def test_results_with_classes_that_are_not_part_of_a_scene_are_refused():
    """A pickle may call whatever it names, and the child process is not trusted."""
    good = pickle.dumps(read_stage(STAGES / "instances.usda"))
    assert load_result(io.BytesIO(good)).name == "instances"
    for name in ("os.system", "builtins.eval", "tiscene.scene.description.np", "tiscene.scene.description.dataclass"):
        module, _, attribute = name.rpartition(".")
        with pytest.raises(pickle.UnpicklingError, match="is not part of a scene"):
            load_result(io.BytesIO(f"c{module}\n{attribute}\n.".encode()))
