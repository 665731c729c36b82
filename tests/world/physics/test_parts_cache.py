# SPDX-License-Identifier: Apache-2.0
"""Convex parts on disk: computed once, the same bits when read, computed again if a file is damaged."""

import numpy as np
import pytest

pytest.importorskip("scipy")

import trimesh

from tiscene.scene.description import Instance, Mesh
from tiscene.world.physics import parts_cache
from tiscene.world.physics.stage_parts import StageParts


@pytest.fixture
def computed(monkeypatch, tmp_path):
    """Return the numbers of triangles of the surfaces whose parts are computed; the cache is an empty folder."""
    monkeypatch.setenv("TISCENE_CACHE", str(tmp_path))
    counts, compute = [], parts_cache.convex_parts

    def counted(triangles, *others):
        counts.append(len(triangles))
        return compute(triangles, *others)

    monkeypatch.setattr(parts_cache, "convex_parts", counted)
    return counts


def meshes():
    bodies = trimesh.creation.torus(1.0, 0.2), trimesh.creation.box((1, 2, 3)), trimesh.creation.icosphere()
    return [
        Mesh(
            f"m{row}",
            np.asarray(each.vertices, np.float32),
            np.asarray(each.faces, np.int32),
            np.zeros(len(each.faces)),
        )
        for row, each in enumerate(bodies)
    ]


def placed(count=3, progress=None):
    shapes = meshes()
    instances = [
        Instance(row % 3, row, np.diag([scale, 1.0, 1.0, 1.0])) for row, scale in enumerate((1.0, 1.0, 1.0, 2.0))
    ][:count]
    found = StageParts(shapes, progress).placed(instances, [True] * count)
    return [
        (
            row,
            pose.tobytes(),
            [(part.kind, part.center.tobytes(), part.half.tobytes(), part.points.tobytes()) for part in parts],
        )
        for row, pose, parts in found
    ]


def test_parts_of_a_stage_are_computed_once_and_have_the_same_bits_when_they_are_read(computed):
    first = placed()
    assert len(computed) == 3
    assert {kind for _, _, parts in first for kind, *_ in parts} == {"hull", "box", "sphere"}
    assert placed() == first
    assert len(computed) == 3
    assert placed(4)[:3] == first  # another size of a mesh is added to the file
    assert len(computed) == 4
    placed(4)
    assert len(computed) == 4


@pytest.mark.parametrize("damage", ["short", "bit", "absent"])
def test_damaged_file_is_computed_again(computed, tmp_path, damage):
    first = placed()
    (file,) = tmp_path.glob("*.parts")
    content = bytearray(file.read_bytes())
    if damage == "bit":
        content[len(content) // 2] ^= 1
    file.write_bytes(content[:-9] if damage == "short" else content)
    if damage == "absent":
        file.unlink()
    assert placed() == first
    assert len(computed) == 6


def test_unwritable_folder_is_no_error(computed, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("TISCENE_CACHE", str(tmp_path / "file"))
    with pytest.warns(UserWarning, match="TISCENE_CACHE"):
        assert placed() == placed()
    assert len(computed) == 6


def test_progress_is_reported_while_parts_are_computed_and_not_when_they_are_read(computed):
    calls = []
    placed(progress=lambda task, done: calls.append((task, done)))
    assert [task for task, _ in calls] == ["preparing rigid bodies"] * len(calls)
    shares = [done for _, done in calls]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    calls.clear()
    placed(progress=lambda task, done: calls.append((task, done)))
    assert not calls
