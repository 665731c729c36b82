# SPDX-License-Identifier: Apache-2.0
"""PanoramaPass against path tracing, and independence of its frames from what was rendered before."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dynamics.rotation import multiply
from tests.render.incremental_scenes import (
    BALLS,
    EMISSIVE,
    GLASS,
    GLOSSY,
    LACE,
    MIRROR,
    RED,
    SIZE,
    MovingBalls,
    Position,
)
from tests.render.path_scenes import BOX_CAMERA
from tiscene.render.film.upsample import block_means
from tiscene.render.integrators.incremental.base_image import base_placement
from tiscene.render.integrators.incremental.base_image_cache import BaseImageCache
from tiscene.render.integrators.incremental.mover_coverage import dilated
from tiscene.render.integrators.incremental.retrace_kernels import MOVER_HITS
from tiscene.render.integrators.labels.label_pass import LabelPass
from tiscene.render.integrators.panorama import panorama
from tiscene.render.integrators.panorama.light_changes import REDUCTION, LightChanges, reduced_view
from tiscene.render.integrators.panorama.panorama_pass import PanoramaImage, PanoramaPass
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.view import CubeView, View
from tiscene.scene.description import Material

DEPTH = 5
ONE = BALLS[:1]


def view_at(degrees: float) -> View:
    """Return the view of the box's camera, turned to the left about the vertical axis."""
    half = 0.5 * np.radians(degrees)
    rotation = multiply(np.array([np.cos(half), 0.0, np.sin(half), 0.0]), np.array(BOX_CAMERA.rotation))
    camera = replace(BOX_CAMERA, rotation=tuple(rotation.tolist()))
    return View(camera, camera, camera, *SIZE)


TURNING = View(view_at(-1.0).current, view_at(0.0).current, view_at(1.0).current, *SIZE)


class SurroundedBalls(MovingBalls):
    """The Cornell box with moving balls, rendered over panoramas."""

    def __init__(self, mover: Material = RED, wall: Material | None = None, lights: str = "lamp") -> None:
        super().__init__(mover, wall, lights)
        self.paths = PathPass(self.device, *SIZE)
        self.labels = LabelPass(self.device)
        self.reported: list[tuple[str, float]] = []
        self.surrounded = self.new_pass()

    def new_pass(self, memory_limit: int = 1 << 26, images: BaseImageCache | None = None) -> PanoramaPass:
        return PanoramaPass(
            self.paths,
            memory_limit=memory_limit,
            progress=lambda stage, done: self.reported.append((stage, done)),
            images=images,
        )

    def image(
        self, *positions: Position, degrees: float = 0.0, frame: int = 0, spp: int = 4, panorama_spp: int = 64
    ) -> PanoramaImage:
        return self.image_of(view_at(degrees), *positions, frame=frame, spp=spp, panorama_spp=panorama_spp)

    def image_of(
        self, view: View, *positions: Position, frame: int = 0, spp: int = 4, panorama_spp: int = 64
    ) -> PanoramaImage:
        placement = self.at(*positions)
        assert self.surrounded.prepare(
            view, placement, self.moving, frame_index=frame, seed=1, spp=spp, panorama_spp=panorama_spp, max_depth=DEPTH
        )
        self.device.place(placement)
        instance = self.labels.render(view, ["instance"])["instance"]
        return self.surrounded.render(self.moving, instance, spp=max(8, spp))

    def traced(self, *positions: Position, degrees: float = 0.0, spp: int = 256) -> NDArray[np.float32]:
        return self.traced_view(view_at(degrees), *positions, spp=spp)

    def traced_view(self, view: View, *positions: Position, spp: int = 256) -> NDArray[np.float32]:
        self.device.place(self.at(*positions))
        return self.paths.render(view, frame_index=0, seed=2, spp=spp, max_depth=DEPTH).hdr


@pytest.mark.parametrize(
    ("wall", "lights"),
    [
        (None, "sky and bulb"),
        (MIRROR, "lamp"),
        (LACE, "shadowless"),
        pytest.param(GLOSSY, "lamp", marks=pytest.mark.slow),
        pytest.param(EMISSIVE, "lamp", marks=pytest.mark.slow),
    ],
    ids=lambda each: getattr(each, "name", str(each)),
)
def test_mean_light_equals_that_of_path_tracing(wall: Material | None, lights: str) -> None:
    scene = SurroundedBalls(wall=wall, lights=lights)
    for degrees, positions in ((0.0, ()), (25.0, ()), (0.0, ONE)):
        image = scene.image(*positions, degrees=degrees, spp=64, panorama_spp=512).hdr
        truth = scene.traced(*positions, degrees=degrees)
        # Lights are brighter than 1, and noisy where pixels show their edges.
        counts = ~dilated(truth.max(axis=-1) > 0.8)
        assert counts.mean() > 0.3
        tolerance = 0.03 if positions else 0.02
        assert image[counts].mean() == pytest.approx(truth[counts].mean(), rel=tolerance), (degrees, positions)


@pytest.mark.parametrize(
    ("mover", "view"), [(RED, TURNING), (GLASS, TURNING), (GLOSSY, view_at(0.0))], ids=["red", "glass", "glossy"]
)
def test_movers_and_their_shadows_are_those_of_path_tracing(mover: Material, view: View) -> None:
    """Where a mover changes the light, the change has the right size; without it the error would be 100 %."""
    scene = SurroundedBalls(mover, lights="sky and bulb")
    image, empty = scene.image_of(view, *ONE, spp=64).hdr, scene.image_of(view, spp=64).hdr
    truth, truth_empty = scene.traced(*ONE), scene.traced()
    changed = np.abs(truth - truth_empty).mean(axis=-1) > 0.1 * truth_empty.mean(axis=-1)
    assert 0.02 < changed.mean() < 0.5
    change, expected = (image - empty)[changed], (truth - truth_empty)[changed]
    assert change.mean() == pytest.approx(expected.mean(), rel=0.1, abs=0.003)
    assert np.abs(change - expected).mean() < 0.4 * np.abs(expected).mean()


def test_denoised_light_is_that_of_the_known_shares_of_pixels_also_beside_movers() -> None:
    image = SurroundedBalls().image((-0.7, 0.0, -0.3), degrees=3.0)  # near a wall
    assert (image.beside > 0.0).any()
    known = image.static_mask[..., 0]
    assert (known[image.beside > 0.0] == 1.0).all()
    assert not image.denoised[known == 0.0].any()


@pytest.mark.parametrize(
    "wall",
    [pytest.param(None, marks=pytest.mark.slow), GLOSSY, pytest.param(EMISSIVE, marks=pytest.mark.slow)],
    ids=lambda each: each.name if each else "no wall",
)
def test_movers_that_emit_light_the_box_as_in_path_tracing(wall: Material | None) -> None:
    """Their light is added to that of the static scene, whose lamps and emissive surfaces are not counted again."""
    scene = SurroundedBalls(replace(EMISSIVE, emissive_color=(40.0, 30.0, 10.0)), wall=wall)
    image = scene.image(*ONE, spp=64, panorama_spp=256)
    changes, emitting = scene.surrounded._changes, scene.moving & (np.cumsum(scene.moving) == 1)
    assert changes is not None
    light = changes.light_of(emitting, TURNING, key=5, spp=256, max_depth=DEPTH)
    before = scene.traced(spp=512)
    truth = block_means(scene.traced(*ONE, spp=512) - before, REDUCTION)
    # The image of reduced size has no lamp: there it shows the wall behind it.
    other = image.traced | dilated(before.max(axis=-1) > 5.0)
    empty = block_means(other[..., None].astype(np.float32), REDUCTION)[..., 0] == 0.0
    assert empty.mean() > 0.5
    assert truth[empty].mean() > 0.1
    assert light[empty].mean() == pytest.approx(truth[empty].mean(), rel=0.05)
    assert np.abs(light[empty] - truth[empty]).mean() < 0.1 * truth[empty].mean()
    assert image.emitted is not None
    assert scene.image(*ONE[:0]).emitted is None
    assert (image.hdr[~image.normal.any(axis=-1) & ~image.traced] == 0.0).all(), "there is nothing that is lit"


@pytest.mark.parametrize("wall", [GLOSSY, MIRROR], ids=lambda each: each.name)
def test_frames_do_not_depend_on_frames_rendered_before(wall: Material) -> None:
    scene = SurroundedBalls(wall=wall, lights="sky and bulb")
    forth = {degrees: scene.image(*BALLS, degrees=degrees, frame=degrees) for degrees in (0, 20, 100)}
    scene.surrounded = scene.new_pass()
    for degrees in (100, 0, 20):
        again = scene.image(*BALLS, degrees=degrees, frame=degrees)
        for name in ("hdr", "static", "denoised", "albedo", "normal", "after"):
            first = getattr(forth[degrees], name)
            np.testing.assert_array_equal(getattr(again, name), first, err_msg=f"{degrees} degrees: {name}")


def test_frames_of_a_resting_view_share_their_static_paths_and_are_those_of_new_passes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    recorded = []
    record = LightChanges.record
    monkeypatch.setattr(LightChanges, "record", lambda *args, **kwargs: recorded.append(record(*args, **kwargs)))
    scene = SurroundedBalls(lights="sky and bulb")
    moved = tuple(np.add(ONE[0], (0.1, 0.0, 0.05)).tolist())
    images = [scene.image(*positions, frame=index).hdr for index, positions in enumerate([(), ONE, [moved], ONE])]
    assert len(recorded) == 1
    np.testing.assert_array_equal(images[3], images[1])
    scene.surrounded = scene.new_pass()
    np.testing.assert_array_equal(scene.image(moved, frame=9).hdr, images[2])
    assert np.abs(images[2] - images[1]).max() > 0.1
    scene.image(moved, spp=8)
    assert len(recorded) == 3


def test_paths_far_from_movers_are_not_traced_on_and_change_nothing() -> None:
    """Paths of two segments lose nothing: the first that leaves a surface is the last."""
    scene, changes, rows = SurroundedBalls(lights="sky and bulb"), [], []
    placement = scene.at(*ONE)
    for view in (view_at(0.0), TURNING):
        scene.image_of(view)
        found = LightChanges(scene.device, view)
        scene.device.place(base_placement(placement, scene.moving))
        probe = next(iter(scene.surrounded.panoramas)).probe
        found.record(view, placement, scene.moving, probe, (1, 2), spp=16, max_depth=2)
        scene.device.place(placement)
        changes.append(found.find(scene.moving, np.ones((1, 3), np.float32)))
        rows.append(found._cache.max_rows)
    both = (changes[0][..., MOVER_HITS] == 0.0) & (changes[1][..., MOVER_HITS] == 0.0)
    np.testing.assert_allclose(changes[1][both, :3], changes[0][both, :3], atol=1e-6)
    assert np.abs(changes[0][both, :3]).max() > 0.01
    paths = 16 * changes[0].shape[0] * changes[0].shape[1]
    assert 0 < rows[1] - paths < 0.2 * (rows[0] - paths)  # besides the rays from the camera


def test_cells_that_do_not_fit_are_traced_again_with_the_same_light() -> None:
    scene = SurroundedBalls(lights="sky and bulb")
    images = {degrees: scene.image(degrees=degrees).hdr for degrees in (0.0, 90.0)}
    scene.surrounded = small = scene.new_pass(memory_limit=1)
    for degrees in (0.0, 90.0, 0.0):
        np.testing.assert_array_equal(scene.image(degrees=degrees).hdr, images[degrees])
    (panorama,) = small.panoramas
    assert not any(map(len, panorama.missing(view_at(0.0))))
    assert all(map(len, panorama.missing(view_at(90.0))))


def test_turning_back_traces_nothing_and_turning_on_traces_what_is_new() -> None:
    scene = SurroundedBalls()
    counts = []
    for degrees in (0.0, 30.0, 0.0, 15.0):
        scene.reported.clear()
        scene.image(degrees=degrees)
        counts.append(len(scene.reported))
    assert counts[0] > 0 < counts[1]
    assert counts[2:] == [0, 0]
    scene.image(degrees=90.0)
    assert scene.reported[-1] == ("panorama", 1.0)


def test_panorama_belongs_to_the_static_scene_and_its_lights() -> None:
    scene = SurroundedBalls(lights="sky and bulb")
    lit = scene.image().hdr
    scene.image(*BALLS)
    assert len(scene.surrounded.panoramas) == 1
    scene.dim((0.0, 0.0, 0.0))
    dimmed = scene.image().hdr
    assert len(scene.surrounded.panoramas) == 2
    assert dimmed.mean() < 0.9 * lit.mean()


def test_background_of_one_color_is_there_once_for_all_light_groups() -> None:
    scene = SurroundedBalls(lights="sky and bulb")
    scene.dim((0.5, 0.5, 0.5), (2.0, 2.0, 2.0))
    view = replace(view_at(25.0), background=(0.2, 0.4, 0.6))
    image, truth = scene.image_of(view, panorama_spp=256).hdr, scene.traced_view(view)
    empty = scene.labels.render(view, ["instance"])["instance"] == 0
    assert 0.3 < empty.mean() < 0.8
    np.testing.assert_allclose(image[empty], truth[empty], rtol=1e-3)
    edges = dilated(empty) & ~empty
    np.testing.assert_allclose(image[edges].mean(axis=0), truth[edges].mean(axis=0), rtol=0.05)


def test_pixels_of_the_reduced_view_are_blocks_of_pixels() -> None:
    camera = replace(BOX_CAMERA, aperture_offset=(0.1, -0.05))
    view = View(camera, camera, camera, 33, 25)
    reduced = reduced_view(view)
    size = -(-33 // REDUCTION), -(-25 // REDUCTION)
    assert (reduced.width, reduced.height) == size
    full, small = camera.intrinsics(33, 25), reduced.current.intrinsics(*size)
    for x, y in ((0, 0), (size[0] - 1, size[1] - 1), (3, 2)):
        center = 0.5 * (REDUCTION - 1)  # of a block, in pixels from its first
        middle = np.linalg.solve(full, (REDUCTION * x + center, REDUCTION * y + center, 1.0))
        np.testing.assert_allclose(small @ middle, (x, y, 1.0), atol=1e-9)


def test_cells_on_disk_are_those_that_were_made(tmp_path: Path) -> None:
    scene = SurroundedBalls(wall=GLOSSY, lights="sky and bulb")
    images = BaseImageCache(tmp_path)
    scene.surrounded = scene.new_pass(images=images)
    first = scene.image(*BALLS)
    assert scene.reported
    assert first.hdr.dtype == first.denoised.dtype == np.float32
    # Blocks are enough; without them, tiles are denoised again.
    for lost, traces in (((), False), (("tiles",), False), (("tiles", "blocks"), True), (("blocks",), False)):
        for kind in lost:
            for path in tmp_path.glob(f"*-{kind}-*"):
                path.unlink()
        scene.reported.clear()
        scene.surrounded = scene.new_pass(images=images)
        again = scene.image(*BALLS)
        np.testing.assert_array_equal(again.hdr, first.hdr)
        np.testing.assert_array_equal(again.denoised, first.denoised)
        assert bool(scene.reported) == traces, lost
    scene.dim((0.5, 0.5, 0.5))
    scene.image()
    assert scene.reported


def test_albedo_and_normals_are_those_of_path_tracing() -> None:
    scene = SurroundedBalls(lights="sky and bulb")
    for degrees in (0.0, 20.0):
        image = scene.image(degrees=degrees)
        scene.device.place(scene.at())
        truth = scene.paths.render(view_at(degrees), frame_index=0, seed=2, spp=64, max_depth=DEPTH)
        assert truth.normal.min() < -0.9
        for name in ("albedo", "normal"):
            assert np.abs(getattr(image, name) - getattr(truth, name)).mean() < 0.02, (degrees, name)


def test_tiles_in_which_light_varies_have_further_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[tuple[int, int]] = []
    sums = PathPass.sums

    def counted(
        self: PathPass, view: View | CubeView, pixels: NDArray[np.int32], **options: Any
    ) -> NDArray[np.float32]:
        if isinstance(view, CubeView) and view.margin > 0:
            calls.append((options["spp"], len(pixels)))
        return sums(self, view, pixels, **options)

    monkeypatch.setattr(PathPass, "sums", counted)
    scene = SurroundedBalls()
    scene.image(panorama_spp=256)
    pixels = {spp: sum(number for each, number in calls if each == spp) for spp, _ in calls}
    first, further = pixels[min(pixels)], pixels[max(pixels)]
    assert 0.02 * first < further < 0.6 * first


@pytest.mark.parametrize(("quality", "fine_spp", "ratio"), [("high", 4, 0.6), ("fast", 128, 0.67)])
def test_denoised_light_has_less_noise_also_at_the_edges_of_the_cube(
    monkeypatch: pytest.MonkeyPatch, quality: str, fine_spp: int, ratio: float
) -> None:
    monkeypatch.setattr(panorama, "FINE_SPP", fine_spp)
    # One sample a cell, so that most of the error is noise.
    for name, value in (("LEAST_SPP", 1), ("CONTRAST", 1.0), ("FINE_CONTRAST", 1.0), ("CELL_OF_CENTER", 0.35)):
        monkeypatch.setattr(panorama, name, value)
    scene = SurroundedBalls()
    for degrees in (0.0, 25.0):
        image, truth = scene.image(degrees=degrees, panorama_spp=4), scene.traced(degrees=degrees)
        counts = ~dilated(truth.max(axis=-1) > 0.8)
        noisy, clean = (np.abs(each - truth)[counts].mean() for each in (image.static, image.denoised))
        assert clean < ratio * noisy, (quality, degrees, clean / noisy)
        assert image.denoised[counts].mean() == pytest.approx(truth[counts].mean(), rel=0.03)
