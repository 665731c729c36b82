# SPDX-License-Identifier: Apache-2.0
"""The path pass against Mitsuba 3's `path` integrator, on the same geometry, lights and materials."""

import mitsuba
import numpy as np
import pytest
from scipy import stats

from tests.reference import mitsuba_scene
from tests.render.path_scenes import BOX_CAMERA, CORNELL, ball, box, described, device_scene, matte, towards
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.view import View
from tiscene.scene.description import (
    DiskLight,
    DistantLight,
    DomeLight,
    Material,
    RectLight,
    SceneDescription,
    SphereLight,
)

SIZE = 32
RUNS, SPP, DEPTH = 16, 48, 6


def cornell() -> SceneDescription:
    """Return a Cornell box with a rectangular light."""
    meshes, materials = box(CORNELL)
    lamp = RectLight("lamp", "/lamp", towards((0.0, 0.99, 0.0), (0.0, -1.0, 0.0)), (18.0, 15.0, 8.0), 0.6, 0.5)
    return described(meshes, materials, [lamp])


def many_lights() -> SceneDescription:
    """Return a scene with every kind of light that both renderers have, and an emissive mesh."""
    meshes, materials = box(CORNELL)
    meshes.append(ball((-0.2, -0.1, 0.7), 0.15, 3, 3))
    materials.append(matte("emissive", (0.3, 0.3, 0.3), emissive_color=(1.0, 2.0, 4.0)))
    lights = [
        DiskLight("disk", "/disk", towards((-0.5, 0.999, 0.2), (0.0, -1.0, 0.0)), (6.0, 6.0, 6.0), 0.2),
        SphereLight("sphere", "/sphere", towards((0.6, 0.3, -0.4), (0.0, 0.0, -1.0)), (9.0, 6.0, 3.0), 0.12),
        DistantLight("sun", "/sun", towards((0.0, 0.0, 0.0), (0.3, -0.4, -1.0)), (0.8, 0.8, 0.7)),
        DomeLight("sky", "/sky", np.eye(4), (0.3, 0.4, 0.6)),
    ]
    return described(meshes, materials, lights)


def glass_and_mirror() -> SceneDescription:
    """Return a box with a glass ball and a mirror ball below a large light."""
    meshes, materials = box([(0.6, 0.3, 0.2), (0.2, 0.3, 0.6), (0.7, 0.7, 0.7)])
    meshes = [*meshes[:5], ball((-0.45, -0.55, 0.1), 0.42, 3, 5), ball((0.45, -0.5, -0.3), 0.45, 4, 5)]
    materials += [
        Material("glass", opacity=0.0, roughness=0.0, ior=1.5),
        Material("mirror", diffuse_color=(1.0, 1.0, 1.0), metallic=1.0, roughness=0.0),
    ]
    lamp = RectLight("lamp", "/lamp", towards((0.0, 0.99, 0.0), (0.0, -1.0, 0.0)), (4.0, 4.0, 4.0), 1.6, 1.6)
    return described(meshes, materials, [lamp])


def tiscene_runs(description: SceneDescription, depth: int) -> np.ndarray:
    """Return images with different seeds, [runs, h, w, 3]."""
    paths = PathPass(device_scene(description), SIZE, SIZE)
    view = View(BOX_CAMERA, BOX_CAMERA, BOX_CAMERA, SIZE, SIZE)
    runs = []
    for seed in range(RUNS):
        runs.append(paths.render(view, frame_index=0, seed=seed, spp=SPP, max_depth=depth).hdr)
        assert paths.nonfinite == 0
    return np.array(runs, np.float64)


def mitsuba_runs(description: SceneDescription, depth: int) -> np.ndarray:
    """Return images with different seeds, [runs, h, w, 3]."""
    mitsuba.set_variant("scalar_rgb")
    scene = mitsuba_scene.scene(mitsuba, description, BOX_CAMERA, SIZE, SIZE, max_depth=depth, spp=SPP)
    # More samples compensate for independent sampling and uniform light selection.
    return np.array(
        [np.array(mitsuba.render(scene, spp=3 * SPP, seed=1000 + run)) for run in range(RUNS)], dtype=np.float64
    )


@pytest.mark.parametrize(
    ("build", "depth"),
    [
        (cornell, 2),
        *(
            pytest.param(*each, marks=pytest.mark.slow)
            for each in ((many_lights, DEPTH), (cornell, DEPTH), (glass_and_mirror, 8))
        ),
    ],
    ids=["direct light", "every light", "cornell box", "glass and mirror"],
)
def test_images_match_mitsuba(build: object, depth: int) -> None:
    description = build()
    ours, theirs = tiscene_runs(description, depth), mitsuba_runs(description, depth)
    ours_mean, theirs_mean = ours.mean(axis=0), theirs.mean(axis=0)
    error = np.hypot(ours.mean(axis=(1, 2, 3)).std(), theirs.mean(axis=(1, 2, 3)).std()) / np.sqrt(RUNS)
    assert error < 0.0025 * theirs_mean.mean()  # otherwise the next assertion would be weak
    assert ours_mean.mean() == pytest.approx(theirs_mean.mean(), rel=5e-3)

    # Welch's test of every pixel's brightness, with Šidák's correction for one false alarm in a hundred images. Pixels
    # at silhouettes and caustics are not normally distributed: one in a thousand may fail.
    ours, theirs = ours.mean(axis=3), theirs.mean(axis=3)
    noisy = np.minimum(ours.std(axis=0), theirs.std(axis=0)) > 1e-4 * theirs.mean()
    assert ours.mean(axis=0)[~noisy] == pytest.approx(theirs.mean(axis=0)[~noisy], rel=5e-3, abs=1e-3)
    p = stats.ttest_ind(ours[:, noisy], theirs[:, noisy], axis=0, equal_var=False).pvalue
    assert p.size > 0.4 * SIZE * SIZE
    assert (p < 1.0 - (1.0 - 0.01) ** (1.0 / p.size)).sum() <= p.size // 1000
    assert stats.kstest(p, "uniform").statistic < 0.06
