# SPDX-License-Identifier: Apache-2.0
"""Cameras that walk: anchors, and images reprojected from their panoramas."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.render.incremental_scenes import BALLS, GLASS, GLOSSY, LACE, MIRROR, SIZE, Position
from tests.render.integrators.panorama.test_panorama_pass import ONE, SurroundedBalls
from tests.render.path_scenes import BOX_CAMERA
from tiscene.frame.buffers import LABELS
from tiscene.render.integrators.incremental.base_image_cache import BaseImageCache
from tiscene.render.integrators.incremental.mover_coverage import dilated
from tiscene.render.integrators.labels.label_pass import LabelPass
from tiscene.render.integrators.labels.static_labels import ALL_TIMES
from tiscene.render.integrators.panorama import light_probes, reprojection
from tiscene.render.integrators.panorama import reprojection_kernels as kernels
from tiscene.render.integrators.panorama.anchors import MAX_SPACING, Anchors
from tiscene.render.integrators.panorama.light_probe import ProbeSampling, trace_probe
from tiscene.render.integrators.panorama.panorama_pass import PanoramaImage
from tiscene.render.view import View
from tiscene.scene.camera import Vector3
from tiscene.scene.description import Material

SLOW = (0.01, 0.0, -0.02)  # m per frame


def walking(position: Vector3, step: Vector3 = SLOW) -> View:
    """Return the view of the box's camera at a position, while it moves by a step a frame."""
    here = np.array(position)
    cameras = (replace(BOX_CAMERA, position=tuple((here + k * np.array(step)).tolist())) for k in (-1, 0, 1))
    return View(*cameras, *SIZE)


def standing(position: Vector3, axes: frozenset[int] = frozenset({0, 2})) -> View:
    """Return the view of a camera that rests where others walk, and walks along some axes at other times."""
    return replace(walking(position, (0.0, 0.0, 0.0)), walks=axes)


def assert_same_image(image: PanoramaImage, expected: PanoramaImage, frame: int) -> None:
    for name in ("hdr", "static", "denoised", "albedo", "normal", "after", "traced", "static_mask"):
        np.testing.assert_array_equal(getattr(image, name), getattr(expected, name), err_msg=f"{frame}: {name}")
    for one, other in zip(image.hidden, expected.hidden, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.fixture(scope="module")
def empty_box() -> SurroundedBalls:
    scene = SurroundedBalls()
    scene.device.place(scene.at())
    return scene


@pytest.fixture
def anchors(empty_box: SurroundedBalls) -> Anchors:
    empty_box.device.place(empty_box.at())
    return Anchors(empty_box.device)


def test_a_turning_camera_is_its_own_anchor(anchors: Anchors) -> None:
    position = (0.123, 0.456, 3.3)
    assert anchors.nearest(walking(position, (0.0, 0.0, 0.0))) == position


def test_anchors_are_the_nearest_points_of_a_lattice(anchors: Anchors) -> None:
    view = walking((0.2, 0.1, 3.1), (0.01, 0.01, 0.01))
    assert anchors.nearest(view) == (0.0, 0.0, 3.0)
    assert anchors.nearest(walking((0.27, 0.3, 3.3), (0.01, 0.01, 0.01))) == (0.5, 0.5, 3.5)


def test_anchors_are_at_the_height_of_a_camera_that_keeps_it(anchors: Anchors) -> None:
    heights = {anchors.nearest(walking((0.2, 0.1234 + 1e-9 * k, 3.1)))[1] for k in range(3)}  # type: ignore[index]
    assert len(heights) == 1
    assert heights.pop() == pytest.approx(0.1234, abs=MAX_SPACING / 64)


def test_close_to_surfaces_anchors_are_denser(anchors: Anchors) -> None:
    position = (0.2, 0.1, -0.8)
    anchor = anchors.nearest(walking(position, (0.001, 0.001, 0.001)))
    assert anchor is not None
    assert 0.0 < np.abs(np.subtract(anchor, position)).max() < 0.5 * 0.0625


def test_close_to_surfaces_a_camera_sees_each_anchor_in_four_frames_at_least(anchors: Anchors) -> None:
    position, step = (0.2, 0.1, -0.8), 0.03
    found = [anchors.nearest(walking((x, *position[1:]), (step, 0.0, 0.0))) for x in np.arange(0.2, 0.5, step)]
    assert {anchor[0] for anchor in found if anchor} == {0.25, 0.375, 0.5}  # 0.125 m apart
    assert None not in found
    long = walking(position, (0.2, 0.0, 0.0))
    anchor = anchors.nearest(replace(long, next=long.current))  # an agent's step
    assert anchor is not None
    assert anchor[0] == 0.25


def test_anchors_behind_walls_do_not_serve(anchors: Anchors) -> None:
    # The box's walls are at -1 and 1; the nearest lattice point in the first case is on the other side.
    sideways = replace(BOX_CAMERA, position=(0.97, 0.1, 0.0))
    for step in (0.01, -0.01):
        cameras = (replace(sideways, position=(0.97, 0.1, k * step)) for k in (-1, 0, 1))
        anchor = anchors.nearest(View(*cameras, *SIZE))
        assert anchor is not None
        assert abs(anchor[0]) < 1.0


def test_a_camera_that_walks_at_other_times_keeps_its_anchor_where_it_stands(anchors: Anchors) -> None:
    position = (0.2, 0.1, 3.1)
    assert anchors.nearest(standing(position)) == anchors.nearest(walking(position)) == (0.0, 0.1015625, 3.0)
    along_x = anchors.nearest(standing(position, frozenset({0})))
    assert along_x == anchors.nearest(walking(position, (0.01, 0.0, 0.0))) != anchors.nearest(standing(position))


def test_a_camera_that_stands_where_it_sees_no_anchor_is_its_own(
    anchors: Anchors, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(anchors, "_sees", lambda eye, points: np.zeros(len(points), np.bool_))
    position = (0.2, 0.1, 3.1)
    assert anchors.nearest(walking(position)) is None
    assert anchors.nearest(standing(position)) == position


def test_a_camera_that_stops_needs_no_further_panorama_and_its_frames_are_those_of_a_new_pass() -> None:
    scene, view = SurroundedBalls(wall=GLOSSY), standing((0.2, 0.1, 3.1))
    scene.image_of(walking((0.2, 0.1, 3.1)), *BALLS)
    stopped = [scene.image_of(view, *positions, frame=k) for k, positions in enumerate((BALLS, ONE, BALLS))]
    assert len(scene.surrounded.panoramas) == 1
    for k, positions in enumerate((BALLS, ONE, BALLS)):
        scene.surrounded = scene.new_pass()
        alone = scene.image_of(view, *positions, frame=k)
        assert_same_image(alone, stopped[k], k)


def test_anchors_near_each_other_share_a_light_probe_that_they_see(anchors: Anchors) -> None:
    centers = {anchors.center_of_probe((x, 0.1, z)) for x in (-0.3, 0.0, 0.4) for z in (2.6, 3.0, 3.4)}
    assert centers == {(0.0, 0.0, 3.0)}
    # The box's walls are at -1 and 1: the lattice's points there do not serve.
    assert anchors.center_of_probe((0.9, 0.9, 0.0)) == (0.0, 0.0, 0.0)


def test_a_walk_traces_its_light_probes_once_and_they_are_on_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    traced: list[Vector3] = []

    def recorded(paths: Any, statics: Any, center: Vector3, sampling: ProbeSampling) -> Any:
        traced.append(center)
        return trace_probe(paths, statics, center, sampling)

    monkeypatch.setattr(light_probes, "trace_probe", recorded)
    scene = SurroundedBalls()
    for _ in range(2):
        scene.surrounded = scene.new_pass(images=BaseImageCache(tmp_path))
        for z in (2.9, 3.4):
            scene.image_of(walking((0.1, 0.0, z)))
        assert len(scene.surrounded.panoramas) == 2
        assert traced == [(0.0, 0.0, 3.0)]
    turning = replace(BOX_CAMERA, position=(0.1, 0.05, 2.9))
    scene.image_of(View(turning, turning, turning, *SIZE))
    assert traced[1:] == [turning.position]


def test_a_long_step_that_does_not_go_on_has_an_anchor(anchors: Anchors) -> None:
    view = walking((0.2, 0.1, 3.1), (0.2, 0.0, -0.2))
    assert anchors.nearest(replace(view, next=view.current)) == (0.0, 0.1015625, 3.0)
    far = walking((0.2, 0.1, 3.1), (0.4, 0.0, -0.4))
    assert anchors.nearest(replace(far, next=far.current)) is None


def test_a_fast_camera_has_no_anchor(anchors: Anchors, empty_box: SurroundedBalls) -> None:
    fast = walking((0.2, 0.1, 3.1), (0.2, 0.0, 0.0))
    assert anchors.nearest(fast) is None
    placement = empty_box.at()
    assert not empty_box.surrounded.prepare(
        fast, placement, empty_box.moving, frame_index=0, seed=1, spp=1, panorama_spp=16, max_depth=3
    )


def test_images_whose_subpixels_or_cells_are_too_many_have_no_panorama(empty_box: SurroundedBalls) -> None:
    view = walking((0.2, 0.1, 3.1))
    distant = replace(view.current, vertical_fov=0.001)
    for each in (replace(view, width=1 << 14, height=1 << 12), View(distant, distant, distant, *SIZE)):
        assert not empty_box.surrounded.prepare(
            each, empty_box.at(), empty_box.moving, frame_index=0, seed=1, spp=1, panorama_spp=16, max_depth=3
        )


@pytest.mark.parametrize(
    ("wall", "lights"),
    [
        pytest.param(None, "sky and bulb", marks=pytest.mark.slow),
        pytest.param(GLASS, "lamp", marks=pytest.mark.slow),
        (LACE, "shadowless"),
        pytest.param(GLOSSY, "lamp", marks=pytest.mark.slow),
        pytest.param(MIRROR, "lamp", marks=pytest.mark.slow),
    ],
    ids=lambda each: getattr(each, "name", str(each)),
)
def test_mean_light_equals_that_of_path_tracing(wall: Material | None, lights: str) -> None:
    scene = SurroundedBalls(wall=wall, lights=lights)
    for place, positions in (((0.2, 0.1, 3.2), ()), ((-0.13, 0.05, 2.76), ()), ((0.1, 0.0, 3.3), ONE)):
        view = walking(place)
        image = scene.image_of(view, *positions, spp=64, panorama_spp=512)
        truth = scene.traced_view(view, *positions)
        # Lights are brighter than 1, and noisy where pixels show their edges. The box ends in the first columns.
        counts = ~dilated(truth.max(axis=-1) > 0.8)
        counts[:, :2] = counts[:, -2:] = False
        assert counts.mean() > 0.3
        assert image.hdr[counts].mean() == pytest.approx(truth[counts].mean(), rel=0.03), (place, positions)
        assert np.abs(image.denoised - truth)[counts & (image.static_mask[..., 0] == 1.0)].mean() < 0.1 * truth.mean()


def test_what_the_anchor_does_not_see_and_what_looks_different_from_there_is_path_traced() -> None:
    scene = SurroundedBalls(wall=MIRROR, lights="sky and bulb")
    view = walking((0.24, 0.0, 3.26))
    image = scene.image_of(view, spp=64, panorama_spp=64)
    instance = scene.labels.render(view, ["instance"])["instance"]
    mirror = instance == np.unique(instance)[-1]
    assert mirror.mean() > 0.02
    interior = mirror & ~dilated(~mirror)
    assert image.traced[interior].all()
    rim = mirror & ~interior  # too narrow for the mirror's look from elsewhere to matter
    assert (image.static_mask[rim] > 0.0).mean() > 0.7
    truth = scene.traced_view(view)
    shown, expected = (np.minimum(each[interior], 2.0).mean() for each in (image.hdr, truth))  # the sun is brighter
    assert shown == pytest.approx(expected, rel=0.05)
    partial = (image.static_mask[..., 0] < 1.0) & ~image.traced  # beside the mirror, behind its edge
    assert 0.0 < partial.mean() < 0.2
    np.testing.assert_array_equal(image.hidden.pixels, np.flatnonzero(partial))
    assert image.hidden.light.any()


def test_frames_do_not_depend_on_frames_rendered_before() -> None:
    scene = SurroundedBalls(wall=GLOSSY, lights="sky and bulb")
    places = [(0.1 * k, 0.05, 3.4 - 0.15 * k) for k in range(4)]
    forth = [scene.image_of(walking(place), *BALLS, frame=k) for k, place in enumerate(places)]
    assert len(scene.surrounded.panoramas) > 1
    scene.surrounded = scene.new_pass()
    for k in (2, 0, 3, 1):
        again = scene.image_of(walking(places[k]), *BALLS, frame=k)
        assert_same_image(again, forth[k], k)


def test_edges_are_traced_in_parts_with_the_same_result(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, view = SurroundedBalls(wall=GLOSSY), walking((0.2, 0.1, 3.2))
    whole = scene.image_of(view)
    monkeypatch.setattr(reprojection, "AT_ONCE", 100)
    np.testing.assert_array_equal(scene.image_of(view).hdr, whole.hdr)


def test_rays_go_through_the_subpixels_of_edges_only(
    empty_box: SurroundedBalls, monkeypatch: pytest.MonkeyPatch
) -> None:
    view = walking((0.2, 0.1, 3.1))
    edges = np.zeros((view.height, view.width), bool)
    make_rays = kernels.subpixel_rays

    def recorded(pixels: NDArray[np.int32], *args: Any) -> None:
        edges.reshape(-1)[pixels] = True
        make_rays(pixels, *args)

    monkeypatch.setattr(kernels, "subpixel_rays", recorded)
    empty_box.device.place(empty_box.at())
    reprojection.Reprojection(empty_box.device).trace(view, (0.0, 0.1, 3.0))
    depth = np.minimum(empty_box.labels.render(view, ["depth"])["depth"], 100.0)
    steps = [np.abs(np.diff(depth, axis=axis)) / np.take(depth, range(1, depth.shape[axis]), axis) for axis in (0, 1)]
    assert edges[1:][steps[0] > 0.2].all()
    assert edges[:, 1:][steps[1] > 0.2].all()
    assert 0.0 < edges.mean() < 0.5  # the walls are flat


@pytest.mark.parametrize("positions", [BALLS, ONE, ()], ids=len)
@pytest.mark.parametrize("wall", [LACE, MIRROR], ids=lambda each: each.name)
def test_labels_over_static_hits_are_those_of_all_rays(wall: Material, positions: tuple[Position, ...]) -> None:
    scene, there = SurroundedBalls(wall=wall), (0.2, 0.1, 3.1)
    elsewhere = tuple((x + 0.3, y, z) for x, y, z in positions)
    frames = (walking(there), positions), (standing(there), positions), (standing(there), elsewhere)
    for view, places in frames:
        scene.image_of(view, *places)
        assert scene.surrounded.static_hits is not None
        scene.device.place(scene.at(*places), ALL_TIMES)
        expected = scene.labels.render(view, list(LABELS))
        # A new pass has no cached image of the static instances: it takes the static hits.
        labels = LabelPass(scene.device).render(view, list(LABELS), scene.surrounded.static_hits)
        for name in LABELS:
            np.testing.assert_array_equal(labels[name], expected[name], err_msg=name)


def test_walking_on_shows_little_that_is_new() -> None:
    scene = SurroundedBalls()
    scene.image_of(walking((0.1, 0.0, 3.1)))
    scene.reported.clear()
    scene.image_of(walking((0.1, 0.0, 3.1)))
    assert not scene.reported
    (panorama,) = scene.surrounded.panoramas
    before = panorama.bytes
    scene.image_of(walking((0.12, 0.0, 3.06)))
    assert len(scene.surrounded.panoramas) == 1
    assert panorama.bytes <= 2 * before
