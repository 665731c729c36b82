# SPDX-License-Identifier: Apache-2.0
"""Light probes: cells have the light and the plane of their surface, and paths that end in them keep the mean."""

from dataclasses import replace

import numpy as np
import pytest
import taichi as ti
from numpy.typing import NDArray

from tests.render.integrators.panorama.test_panorama_pass import DEPTH, SurroundedBalls, view_at
from tiscene.device.kernel_types import Floats2, Ints2
from tiscene.render.integrators.incremental.base_image import base_placement
from tiscene.render.integrators.panorama.light_probe import PLANE, SIZE, LightProbe, ProbeSampling, trace_probe
from tiscene.render.integrators.path import path_pass
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.integrators.path.path_state import (
    FEATURES_WRITTEN,
    LIVE,
    RADIANCE,
    RELATIVE_IOR2,
    SPREAD,
    PathSamples,
    PathState,
)
from tiscene.render.intersect.ray_queue import upload_rows
from tiscene.render.sampling.cube import FACES, cell_of
from tiscene.render.sampling.sobol import frame_key
from tiscene.render.view import CubeView
from tiscene.scene.camera import Vector3
from tiscene.scene.description import Material

CENTER = (0.0, 0.0, 0.0)
ONE_GROUP = np.ones((1, 3), np.float32)


class Probed:
    """The surrounded balls without movers, and the probe at a point for paths of at most so many segments."""

    def __init__(self, depth: int, wall: Material | None = None, center: Vector3 = (0.05, 0.1, 0.3)) -> None:
        self.balls = SurroundedBalls(wall=wall, lights="sky and bulb")
        self.center = center
        self.device = self.balls.device
        self.static = base_placement(self.balls.at(), self.balls.moving)
        self.paths = PathPass(self.device, SIZE, SIZE)
        cells = trace_probe(self.paths, [self.static], self.center, ProbeSampling(1, 3, depth - 1))
        self.probe = LightProbe(self.center, cells)


@pytest.fixture(scope="module")
def probed() -> Probed:
    return Probed(DEPTH)


def known_cells(probe: LightProbe) -> NDArray[np.bool_]:
    known: NDArray[np.bool_] = (probe.cells[..., :3] != 0.0).any(axis=-1)
    return known


def pixels_of(face: int) -> NDArray[np.int32]:
    """Return the pixels of a face in the view whose pixels are the probe's cells."""
    return np.arange(face * SIZE * SIZE, (face + 1) * SIZE * SIZE, dtype=np.int32)


def test_cells_have_the_light_of_their_surfaces(probed: Probed) -> None:
    known = known_cells(probed.probe)
    assert known.mean() > 0.5
    for face in range(FACES - 1):  # the last one looks out of the box
        film = probed.paths.sums(CubeView(probed.center, SIZE), pixels_of(face), spp=256, key=9, max_depth=DEPTH - 1)
        truth = film[known[face], :3].mean(axis=-1) / 256
        cells = probed.probe.cells[face, known[face], PLANE:].mean(axis=-1)
        # The median, since beside edges the whole cell shows more than the surface in its middle.
        assert np.median(cells / truth) == pytest.approx(1.0, abs=0.03), face


@ti.kernel
def cells_towards(directions: Floats2, size: ti.i32, cells: Ints2):
    for i in range(directions.shape[0]):
        cell = cell_of(ti.math.vec3(directions[i, 0], directions[i, 1], directions[i, 2]), size)
        for c in ti.static(range(3)):
            cells[i, c] = cell[c]


def test_light_of_shiny_surfaces_is_that_of_all_directions() -> None:
    """Two centers see different reflections in the wall, but their cells have the same light."""
    metal = Material("metal", diffuse_color=(0.7, 0.7, 0.7), metallic=1.0, roughness=0.4)
    u, v = np.mgrid[0.05:0.95:24j, 0.05:0.95:24j].reshape(2, -1, 1)
    points = (-0.9, -0.9, 0.6) + u * np.array([0.7, 0.0, 0.0]) + v * np.array([0.0, 1.5, -0.3])
    shown, light = [], []
    for center in ((-0.1, -0.6, 0.9), (-0.7, 0.4, 0.9)):
        probed = Probed(DEPTH, metal, center)
        cells = np.empty((len(points), 3), np.int32)
        cells_towards((points - center).astype(np.float32), SIZE, cells)
        face, row, column = cells.T
        pixels = (face * SIZE + row) * SIZE + column
        film = probed.paths.sums(CubeView(center, SIZE), pixels, spp=64, key=9, max_depth=DEPTH - 1) / 64
        shown.append(film[:, :3])
        light.append(probed.probe.cells[face, row * SIZE + column, PLANE:])
    of_centers, of_cells = (np.abs(one - other).mean() / one.mean() for one, other in (shown, light))
    assert of_centers > 0.5
    assert of_cells < 0.4 * of_centers
    assert light[0].mean() == pytest.approx(light[1].mean(), rel=0.05)


def test_planes_face_the_center_at_the_distance_of_their_surfaces(probed: Probed) -> None:
    known = known_cells(probed.probe)
    planes = probed.probe.cells[..., :PLANE][known]
    np.testing.assert_allclose(np.linalg.norm(planes[:, :3], axis=-1), 1.0, atol=1e-5)
    assert (planes[:, 3] > 0.0).all()


@pytest.mark.parametrize("depth", [DEPTH, 8])  # with 8, at later surfaces than the second too
def test_paths_that_end_in_the_probe_have_the_same_mean_and_fewer_segments(
    monkeypatch: pytest.MonkeyPatch, depth: int
) -> None:
    probed = Probed(depth)
    view = view_at(25.0)
    paths = PathPass(probed.device, view.width, view.height)
    probed.device.place(probed.static)
    pixels = np.arange(view.width * view.height, dtype=np.int32)
    segments: list[int] = []
    closest = path_pass.closest

    def counted(scene: object, tree: object, rays: object, queue: object, count: int, *others: object) -> None:
        segments.append(count)
        closest(scene, tree, rays, queue, count, *others)

    monkeypatch.setattr(path_pass, "closest", counted)
    means, numbers = [], []
    for cache in (None, probed.probe.cache(ONE_GROUP)):
        scene = replace(paths.scene_arrays(), cache=cache)
        segments.clear()
        sums = paths.sums(view, pixels, spp=64, key=frame_key(5, 0), max_depth=depth, scene=scene)
        numbers.append(sum(segments))
        light = sums[:, :3] / 64
        means.append(light[light.max(axis=-1) < 0.8].mean())
    assert means[1] == pytest.approx(means[0], rel=0.02)
    assert numbers[1] < 0.9 * numbers[0]


@pytest.mark.parametrize(
    ("status", "max_depth", "spread", "ior2", "ends"),
    [
        (LIVE | FEATURES_WRITTEN | 1, 2, 1e3, 1.0, True),
        (LIVE | FEATURES_WRITTEN | 0, 8, 1e3, 1.0, False),  # at the first surface
        (LIVE | FEATURES_WRITTEN | 2, 7, 1e3, 1.0, True),  # at the third, with four segments left
        (LIVE | FEATURES_WRITTEN | 2, 6, 1e3, 1.0, False),  # with three segments left
        (LIVE | FEATURES_WRITTEN | 3, 7, 1e3, 1.0, False),  # at the fourth
        (LIVE | 1, 8, 1e3, 1.0, False),  # the first surface is a mirror, whose features are not known yet
        (LIVE | FEATURES_WRITTEN | 1, 8, 1e-6, 1.0, False),  # narrower than a cell
        (LIVE | FEATURES_WRITTEN | 1, 8, 1e3, 2.25, False),  # within glass
    ],
)
def test_paths_end_at_the_surfaces_that_the_probe_knows(
    probed: Probed, status: int, max_depth: int, spread: float, ior2: float, ends: bool
) -> None:
    face, count = 4, SIZE * SIZE  # the back wall
    probed.device.place(probed.static)
    state, pixels, samples = PathState(count), pixels_of(face), PathSamples(1, 0, 7)
    scene = replace(probed.paths.scene_arrays(), cache=probed.probe.cache(ONE_GROUP))
    with probed.paths.restricted_to(upload_rows(pixels, pixels)):
        probed.paths.start(CubeView(probed.center, SIZE), state, 0, count, samples)
        rows = state.state.to_numpy()
        rows[:, SPREAD], rows[:, RELATIVE_IOR2] = spread, ior2
        state.state.from_numpy(rows)
        state.status.fill(status)
        live, _ = probed.paths.advance(scene, state, count, 0, 0, samples, max_depth, mis=1)
    found = state.status.to_numpy()
    ended = found == 0
    assert live == (found & LIVE != 0).sum()
    assert ended.mean() > 0.5 if ends else not ended.any()
    radiance = state.state.to_numpy()[:, RADIANCE : RADIANCE + 3]
    assert (radiance[~ended] == 0.0).all()
    if ends:
        light = probed.probe.cells[face, :, PLANE:]
        assert radiance[ended].mean() == pytest.approx(light[known_cells(probed.probe)[face]].mean(), rel=0.1)


def test_groups_of_lights_are_scaled_apart() -> None:
    cells = np.zeros((FACES, SIZE * SIZE, PLANE + 6), np.float32)
    cells[2, 5, PLANE:] = 1.0, 2.0, 3.0, 10.0, 20.0, 30.0
    cells[2, 5, :PLANE] = 0.0, -1.0, 0.0, 1.5
    cache = LightProbe(CENTER, cells).cache(np.array([[1.0, 1.0, 1.0], [0.5, 0.0, 2.0]], np.float32))
    row = cache.cells.to_numpy()[2 * SIZE * SIZE + 5]
    np.testing.assert_allclose(row, [6.0, 2.0, 63.0, 1.5, 0.0, -1.0, 0.0, 0.0])
