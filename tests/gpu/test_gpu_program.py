# SPDX-License-Identifier: Apache-2.0
"""The program for GPUs runs to its end on the CPU, and finds what differs."""

import os
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from tests.gpu import __main__ as program
from tests.gpu import bake, kit, parts
from tests.gpu.baked_scene import SPHERE, BakedScene, load
from tests.gpu.checks import Check


@pytest.fixture(scope="module")
def sphere(tmp_path_factory) -> BakedScene:
    """The closed sphere, written and read back."""
    folder = tmp_path_factory.mktemp("scenes")
    scene = bake._still(SPHERE, bake.sphere())
    scene.save(folder)
    return load(folder)[0]


@pytest.mark.slow
def test_labels_of_the_same_machine_are_equal(sphere):
    assert all(check.passed for check in parts.labels([sphere], 0.01))


@pytest.mark.slow
def test_labels_that_differ_are_found(sphere):
    wrong = sphere.labels | {"instance": sphere.labels["instance"] + 1}
    failed = [check for check in parts.labels([replace(sphere, labels=wrong)], 0.01) if not check.passed]
    assert failed[0].what == "sphere: instance"
    assert failed[0].found.startswith("1.0e+00 of pixels differ, (0, 0) 1 for 2 at ")


@pytest.mark.slow
def test_missed_edges_are_found(sphere):
    assert all(check.passed for check in parts.watertight([sphere], 0.001))
    mesh = sphere.description.meshes[0]
    hole = replace(mesh, triangles=mesh.triangles[50:], materials=mesh.materials[50:])
    broken = replace(sphere, description=replace(sphere.description, meshes=(hole,)))
    found = list(parts.watertight([_Aimed(broken, mesh)], 0.001))
    assert not found[0].passed


class _Aimed:
    """A broken scene whose rays are aimed at another mesh."""

    def __init__(self, scene: BakedScene, mesh: object) -> None:
        self.name, self._scene = scene.name, scene
        self.description = replace(scene.description, meshes=(mesh,))

    def device_scene(self):
        return self._scene.device_scene()


def test_scenes_must_be_baked_first(tmp_path, capsys):
    assert program.main(["labels", "--one", "--arch", "cpu", "--scenes", str(tmp_path)]) == 1
    assert "write them first: python -m tests.gpu.bake" in capsys.readouterr().out


@pytest.mark.slow
def test_failures_of_all_kinds_are_counted(sphere, tmp_path, monkeypatch, capsys):
    sphere.save(tmp_path)
    checks = [
        Check("a", "0", False),
        Check("b", "1", np.bool_(False)),
        Check("c", "2", np.bool_(True)),
        Check("d", "3"),
    ]
    monkeypatch.setitem(parts.PARTS, "labels", (lambda scenes, scale: iter(checks), 60))
    assert program.main(["labels", "--one", "--arch", "cpu", "--scenes", str(tmp_path)]) == 2
    assert [line[:4] for line in capsys.readouterr().out.splitlines()] == ["FAIL", "FAIL", "ok  ", "    "]


def test_unknown_part_is_refused(capsys):
    with pytest.raises(SystemExit):
        program.main(["labbels"])
    assert "no part 'labbels'; known: environment, labels" in capsys.readouterr().err


@pytest.mark.slow
def test_program_passes_on_the_cpu(tmp_path):
    """Bake, then run all parts as on a card, without OpenUSD and trimesh."""
    subprocess.run([sys.executable, "-m", "tests.gpu.bake", str(tmp_path)], check=True)
    assert sum(file.stat().st_size for file in tmp_path.iterdir()) < 12e6
    absent = tmp_path / "absent"
    absent.mkdir()
    names = ("pxr", "trimesh", "PIL", "OpenEXR", "rich", "scipy")
    (absent / "sitecustomize.py").write_text(f"import sys\nsys.modules.update(dict.fromkeys({names}))\n")
    command = [sys.executable, "-m", "tests.gpu", "--arch", "cpu", "--scenes", str(tmp_path), "--limits", "3"]
    environment = {**os.environ, "PYTHONPATH": str(absent)}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stdout
    assert "\n0 failed" in done.stdout
    assert np.all([f"\n{name}: " in done.stdout for name in parts.PARTS])


@pytest.mark.slow
def test_kit_runs_without_the_repository(sphere, tmp_path, capsys):
    scenes = tmp_path / "scenes"
    scenes.mkdir()
    sphere.save(scenes)
    kit.main([str(scenes), str(tmp_path / "kit")])
    sizes = [float(size) for size in re.findall(r": ([\d.]+) MiB", capsys.readouterr().out)]
    assert 1.0 < sizes[0] < 10.0  # with the scenes of the bake and a wheel of Taichi (54 MiB): less than 64 MiB
    assert 10.0 < sizes[1] < 25.0
    assert 10.0 < sizes[2] < 60.0
    path = os.pathsep.join(str(tmp_path / "kit" / name) for name in ("code", "rooms", "denoiser"))
    shown = "import tiscene as ts; from tests.gpu import stream_parts as s; print(ts.Stream(s._scenario()).world.stage)"
    found = subprocess.run(
        [sys.executable, "-c", shown],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
    )
    assert found.returncode == 0, found.stderr
    command = [sys.executable, "-m", "tests.gpu", "environment", "denoiser", "--arch", "cpu", "--limits", "5"]
    environment = {**os.environ, "PYTHONPATH": path}
    code = tmp_path / "kit" / "code"
    done = subprocess.run(command, cwd=code, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "sphere: 81,920 triangles" in done.stdout
    assert re.search(r"ok    sphere: squared error: 0\.\d+ of", done.stdout)
    assert "\n0 failed" in done.stdout


@pytest.mark.slow
def test_batches_of_labels_are_compared(sphere):
    checks = list(parts.batch([sphere], 0.01))
    assert checks[0].what == "sphere: 2 frames at once"
    assert checks[0].passed
    assert [check.what for check in checks[1:]] == [
        "sphere: labels, 256x192, one by one",
        "sphere: labels, 256x192, at once",
    ]


@pytest.mark.slow  # test_path_frames.py compares them too
def test_batches_of_colors_are_compared(sphere):
    checks = list(parts.batch_colors([sphere], 0.01))
    assert checks[0].what == "sphere: colors of 2 frames at once"
    assert checks[0].passed
    assert [check.what for check in checks[1:]] == [
        "sphere: 4 spp, 64x48, one by one",
        "sphere: 4 spp, 64x48, at once",
    ]


@pytest.mark.slow
def test_steps_that_one_thread_must_not_do_alone_are_timed(sphere):
    assert all(check.passed in (None, True) for check in parts.serial([sphere], 0.01))
