# SPDX-License-Identifier: Apache-2.0
"""Coverage buffers: fractions of pixels by object and by material."""

from dataclasses import replace

import numpy as np
import pytest

from tests.render.label_scenes import PlacedMesh, Stage, crowd, plate, pose, static_view
from tiscene.render.integrators.labels.label_pass import LabelPass
from tiscene.render.view import View
from tiscene.scene.camera import Camera
from tiscene.scene.description import Material

WIDTH, HEIGHT, FOCAL = 40, 30, 50.0
CAMERA = Camera(position=(0.0, 0.0, 0.0), vertical_fov=2 * np.arctan(0.5 * HEIGHT / FOCAL))
VIEW = static_view(CAMERA, WIDTH, HEIGHT)


def weight_of(coverage: np.ndarray, id: int) -> np.ndarray:
    """Return the fraction of each pixel that an id covers."""
    return np.where(coverage[..., 0] == id, coverage[..., 1], 0.0).sum(axis=-1)


def test_fractions_of_aligned_edges_are_exact() -> None:
    # 1 m is 25 px: the left edge at pixel corner 10.25, the right one at 30.75, upper and lower on corners.
    wide = Stage([plate(20.5 / 25, 10 / 25)], [PlacedMesh(0, [pose((0.5 / 25, 0, -2))], id=7)])
    coverage = wide.render(VIEW, "coverage")["coverage"]
    expected = np.zeros((HEIGHT, WIDTH))
    expected[10:20, 11:30], expected[10:20, [10, 30]] = 1.0, 0.75
    np.testing.assert_array_equal(weight_of(coverage, 7), expected)
    np.testing.assert_array_equal(coverage[..., 0, 0], np.where(expected > 0, 7, 0))
    assert not coverage[..., 1:, :].any()


def test_objects_in_pixel_are_ranked_by_fraction_then_id() -> None:
    # A quarter of the pixel shows object 3, a quarter object 9, and the rest object 5 behind both.
    stage = Stage(
        [plate(1.0, 1.0)],
        [
            PlacedMesh(0, [pose((-0.5 + 5.25 / 25, 0, -2))], id=3),
            PlacedMesh(0, [pose((0.5 + 5.75 / 25, 0, -2))], id=9),
            PlacedMesh(0, [pose((0, 0, -2.001), scale=1.4)], id=5),
        ],
    )
    pixel = stage.render(VIEW, "coverage")["coverage"][15, 25]
    np.testing.assert_array_equal(pixel[:3], [[5, 0.5], [3, 0.25], [9, 0.25]])
    assert not pixel[3:].any()


def test_fractions_match_larger_image() -> None:
    stage = crowd(60)
    view = static_view(Camera.look_at((1.0, 0.8, 7.5), (0.1, 0.0, -1.0)), 32, 24)
    coverage = stage.render(view, "coverage")["coverage"]
    fine = LabelPass(stage.scene).render(View(*view.cameras, 512, 384), ("instance",))["instance"]
    blocks = fine.reshape(24, 16, 32, 16)
    for id in np.unique(fine)[1:]:
        exact = (blocks == id).mean(axis=(1, 3))
        error = np.abs(weight_of(coverage, id) - exact)
        assert error.mean() < 0.01
        assert error.max() < 0.3
    assert (np.diff(coverage[..., 1], axis=-1) <= 0.0).all()
    assert coverage[..., 1].sum(axis=-1).max() <= 1.0
    center = stage.render(view, "instance")["instance"]
    alone = (coverage[..., 0, 1] == 1.0) & (coverage[..., 1, 1] == 0.0)
    assert alone.mean() > 0.1
    np.testing.assert_array_equal(coverage[..., 0, 0][alone], center[alone])


def test_material_fractions_within_one_object() -> None:
    # A plate, 20.5 px wide, whose two triangles have different materials. The bar before it has the material of the
    # upper one, and its own id.
    sheet = plate(20.5 / 25, 10 / 25)
    two = replace(sheet, materials=np.array([1, 2], np.int32))
    materials = [Material(name, prim_path=f"/Looks/{name}") for name in ("Unused", "Lower", "Upper")]
    instances = [PlacedMesh(0, [pose((0, 0, -2))], id=7), PlacedMesh(1, [pose((0, 0, -1.999))], id=8)]
    stage = Stage([two, plate(4.0, 4 / 25, material=2)], instances, materials)
    result = stage.render(VIEW, "material_coverage", "coverage")
    by_object, by_material = result["coverage"], result["material_coverage"]
    assert stage.scene.materials.labels == {0: "", 1: "/Looks/Unused", 2: "/Looks/Lower", 3: "/Looks/Upper"}
    np.testing.assert_array_equal(by_material[..., 1].sum(axis=-1), by_object[..., 1].sum(axis=-1))
    lower, upper = weight_of(by_material, 2), weight_of(by_material, 3)
    assert not weight_of(by_material, 1).any()
    assert lower[:, :9].max() == 0.0
    assert lower[19, 29] == 1.0
    assert upper[11, 11] == 1.0
    np.testing.assert_array_equal(upper[13:17], 1.0)  # only the bar is visible there
    assert lower[17:20].sum() == pytest.approx(3 * 20.5 - upper[17:20].sum(), abs=1e-6)
    shared = (lower > 0.0) & (upper > 0.0) & (lower + upper == 1.0)
    shared[12:18] = False
    assert shared.sum() > 3
    assert (by_object[shared][:, 0] == (7, 1.0)).all()  # one object, two materials
    alone = stage.render(VIEW, "material_coverage")["material_coverage"]
    np.testing.assert_array_equal(alone, by_material)


def test_materials_of_same_prim_share_number() -> None:
    # One prim may give several materials, if its inputs differ between the meshes that it is bound to.
    materials = [
        Material("a", prim_path="/Looks/A"),
        Material("b"),
        Material("a", (1.0, 0.0, 0.0), prim_path="/Looks/A"),
    ]
    meshes = [plate(0.4, 0.4, material=row) for row in range(3)]
    stage = Stage(meshes, [PlacedMesh(row, [pose((0.4 * (row - 1), 0, -2))]) for row in range(3)], materials)
    coverage = stage.render(VIEW, "material_coverage")["material_coverage"]
    assert stage.scene.materials.labels == {0: "", 1: "/Looks/A", 2: "b"}
    np.testing.assert_array_equal(coverage[15, [12, 20, 28], 0], [[1, 1.0], [2, 1.0], [1, 1.0]])


def test_more_objects_than_ranks_keep_lowest_ids() -> None:
    # One object per cell of a 4 x 4 grid in a pixel, which is 4 cm wide there.
    instances = [
        PlacedMesh(0, [pose((0.02 + 0.01 * (i % 4 - 1.5), 0.02 + 0.01 * (i // 4 - 1.5), -2))]) for i in range(16)
    ]
    pixel = Stage([plate(0.01, 0.01)], instances).render(VIEW, "coverage")["coverage"][14, 20]
    np.testing.assert_array_equal(pixel, [[id, 1 / 16] for id in range(1, 7)])
