# SPDX-License-Identifier: Apache-2.0
"""UsdPreviewSurface: samples against density, energy, reciprocity, and the meaning of the inputs."""

import math

import numpy as np
import pytest
from scipy.stats import qmc

from tests.reference.chi_square import (
    MIN_P_VALUE,
    SPHERE_HIGH,
    SPHERE_LOW,
    chi_square,
    directions_of,
    sphere_coordinates,
)
from tests.render.shading import Bsdf
from tiscene.render.bsdfs.energy_tables import AVERAGES_AT, COSINES, ROUGHNESSES, reflection_tables
from tiscene.scene.description import Material, Texture, TextureLookup
from tiscene.scene.material_table import COVERAGE, GLASS, MATTE, MAY_MIRROR, flags_of

WHITE = (1.0, 1.0, 1.0)
MATERIALS = {
    "matte": Material("m", diffuse_color=WHITE, ior=1.0),
    "plastic": Material("m", diffuse_color=WHITE, roughness=0.4),
    "chalk": Material("m", diffuse_color=WHITE, roughness=1.0),
    "polished": Material("m", diffuse_color=WHITE, roughness=0.0),
    "metal": Material("m", diffuse_color=WHITE, metallic=1.0, roughness=0.5),
    "rough metal": Material("m", diffuse_color=WHITE, metallic=1.0, roughness=1.0),
    "mirror": Material("m", diffuse_color=WHITE, metallic=1.0, roughness=0.0),
    "half metal": Material("m", diffuse_color=WHITE, metallic=0.5, roughness=0.6),
    "specular workflow": Material(
        "m", WHITE, use_specular_workflow=True, specular_color=(0.5, 0.2, 0.9), roughness=0.5
    ),
    "lacquer": Material("m", diffuse_color=WHITE, roughness=0.7, clearcoat=1.0, clearcoat_roughness=0.3),
    "glass": Material("m", diffuse_color=WHITE, opacity=0.0, roughness=0.0),
    "frosted glass": Material("m", diffuse_color=WHITE, opacity=0.0, roughness=0.6),
    "rough glass": Material("m", diffuse_color=WHITE, opacity=0.0, roughness=1.0, ior=1.33),
    "milk glass": Material("m", diffuse_color=WHITE, opacity=0.5, roughness=0.5),
    "metallic glass": Material("m", diffuse_color=WHITE, opacity=0.5, metallic=0.5, roughness=1.0),
}
# Single lobes, and lobes too sharp for bins over the sphere.
COAT = Material("m", diffuse_color=(0.0, 0.0, 0.0), ior=1.0, clearcoat=1.0, clearcoat_roughness=0.5)
POLISH = Material("m", (0.0, 0.0, 0.0), use_specular_workflow=True, specular_color=(0.4, 0.3, 0.2), roughness=0.5)
SHARP = {
    "mirror": MATERIALS["mirror"],
    "polished": MATERIALS["polished"],
    "coat": Material("m", diffuse_color=(0.0, 0.0, 0.0), ior=1.0, clearcoat=1.0, clearcoat_roughness=0.01),
    "glass": MATERIALS["glass"],
}
BROAD = [name for name, material in MATERIALS.items() if material.roughness >= 0.4 or name == "matte"]
COUNT = 1 << 16


def outgoing(cosine: float, count: int = COUNT) -> np.ndarray:
    return np.tile([math.sqrt(1.0 - cosine * cosine) * 0.6, math.sqrt(1.0 - cosine * cosine) * 0.8, cosine], (count, 1))


def numbers(count: int = COUNT, seed: int = 5) -> np.ndarray:
    return np.random.default_rng(seed).random((count, 3), np.float32)


@pytest.mark.parametrize("front", [True, False], ids=["outside", "inside"])
@pytest.mark.parametrize("cosine", [0.25, 0.9])
@pytest.mark.parametrize("name", BROAD)
def test_directions_follow_density(name: str, cosine: float, front: bool) -> None:
    check_density(MATERIALS[name], cosine, front)


@pytest.mark.parametrize("cosine", [0.15, 0.5, 0.95])
@pytest.mark.parametrize("lobe", [COAT, POLISH], ids=["coat", "polish"])
def test_directions_of_single_lobe_follow_density(lobe: Material, cosine: float) -> None:
    check_density(lobe, cosine, front=True)


def check_density(material: Material, cosine: float, front: bool) -> None:
    bsdf = Bsdf(material, front=front)
    directions, values = bsdf.sample(outgoing(cosine), numbers())

    def density(coordinates: np.ndarray) -> np.ndarray:
        return bsdf.evaluate(outgoing(cosine, len(coordinates)), directions_of(coordinates))[:, 3]

    kept = values[:, 3] > 0.0  # the rest hit a second microfacet: no sample
    assert np.abs(np.linalg.norm(directions[kept], axis=1) - 1.0).max() < 1e-5
    coordinates = np.where(kept[:, None], sphere_coordinates(directions.astype(np.float64)), 9.0)
    assert chi_square(coordinates, density, SPHERE_LOW, SPHERE_HIGH, (40, 24)) > MIN_P_VALUE


@pytest.mark.parametrize("refracts", [False, True], ids=["reflection", "refraction"])
@pytest.mark.parametrize("name", SHARP)
def test_directions_of_sharp_lobes_follow_density(name: str, refracts: bool) -> None:
    """Binned in a window of a few lobe widths about the lobe's direction."""
    if refracts and name != "glass":
        return
    bsdf, wo = Bsdf(SHARP[name]), outgoing(0.6, 1)[0]
    directions, _ = bsdf.sample(outgoing(0.6), numbers())
    z = wo * (-1.0, -1.0, 1.0)
    if refracts:
        z = np.append(-wo[:2] / 1.5, -math.sqrt(1.0 - (0.8 / 1.5) ** 2))
    x = np.cross(z, (0.0, 1.0, 0.0))
    x /= np.linalg.norm(x)
    frame = np.stack([x, np.cross(z, x), z])
    local = directions.astype(np.float64) @ frame.T
    window = 8e-3
    points = np.where(local[:, 2:] > 0.0, local[:, :2], 9.0)

    def density(at: np.ndarray) -> np.ndarray:
        height = np.sqrt(1.0 - (at**2).sum(axis=1))
        there = np.column_stack([at, height]) @ frame
        return bsdf.evaluate(outgoing(0.6, len(at)), there)[:, 3] / height

    assert (np.abs(points) < window).all(axis=1).mean() > 0.02
    assert chi_square(points, density, (-window, -window), (window, window), (24, 24)) > MIN_P_VALUE


@pytest.mark.parametrize("front", [True, False], ids=["outside", "inside"])
@pytest.mark.parametrize("name", MATERIALS)
def test_white_surfaces_return_all_light(name: str, front: bool) -> None:
    """The estimator's mean of f cos / density is the albedo: 1 within 1 % at every angle."""
    bsdf = Bsdf(MATERIALS[name], front=front)
    even = qmc.Sobol(3, seed=6).random(COUNT)
    for cosine in (0.05, 0.2, 0.4, 0.6, 0.8, 1.0):
        directions, values = bsdf.sample(outgoing(cosine), even)
        weight = np.divide(values[:, :3].T, values[:, 3], out=np.zeros((3, COUNT)), where=values[:, 3] > 0.0)
        if MATERIALS[name].opacity < 1.0:  # radiance is squeezed into a denser medium: that is no loss
            eta = MATERIALS[name].ior if front else 1.0 / MATERIALS[name].ior
            weight *= np.where(directions[:, 2] < 0.0, eta * eta, 1.0)
        assert weight.mean(axis=1) == pytest.approx(1.0, abs=0.01), cosine


@pytest.mark.parametrize("name", BROAD)
def test_importance_sampling_agrees_with_uniform_integration(name: str) -> None:
    """Importance sampling and plain integration over the sphere give the same albedo."""
    bsdf = Bsdf(MATERIALS[name])
    _, values = bsdf.sample(outgoing(0.5), numbers())
    estimate = np.divide(values[:, 1], values[:, 3], out=np.zeros(COUNT), where=values[:, 3] > 0.0).mean()
    cosine, azimuth = np.meshgrid((np.arange(400) + 0.5) / 200 - 1.0, (np.arange(200) + 0.5) / 200 * 2 * np.pi)
    grid = directions_of(np.stack([cosine.ravel(), azimuth.ravel()], axis=-1))
    integral = bsdf.evaluate(outgoing(0.5, len(grid)), grid)[:, 1].mean() * 4.0 * np.pi
    assert estimate == pytest.approx(integral, rel=0.01)


def test_refraction_follows_snell() -> None:
    bsdf = Bsdf(Material("m", opacity=0.0, roughness=0.0, ior=1.5))
    directions, _ = bsdf.sample(outgoing(0.6, 5000), numbers(5000))
    through = directions[directions[:, 2] < 0.0]
    assert 0.85 < len(through) / 5000 < 0.97  # Fresnel: 7 % reflected at 53 degrees
    sine = np.hypot(through[:, 0], through[:, 1])
    assert np.median(sine) == pytest.approx(0.8 / 1.5, abs=2e-3)
    inside = Bsdf(Material("m", opacity=0.0, roughness=0.0, ior=1.5), front=False)
    directions, _ = inside.sample(outgoing(0.5, 2000), numbers(2000))
    assert (directions[:, 2] > 0.0).mean() > 0.999  # total internal reflection


def test_smooth_metal_reflects_like_a_mirror() -> None:
    directions, values = Bsdf(MATERIALS["mirror"]).sample(outgoing(0.7, 2000), numbers(2000))
    expected = outgoing(0.7, 1)[0] * (-1, -1, 1)
    angles = np.degrees(np.arccos(np.clip(directions.astype(np.float64) @ expected, -1.0, 1.0)))
    assert np.percentile(angles, 50) < 0.2
    assert np.percentile(angles, 95) < 1.0
    assert (values[:, 0] / values[:, 3]).mean() == pytest.approx(1.0, abs=5e-3)


def test_energy_tables_are_consistent() -> None:
    tables = reflection_tables()
    directional = tables[:AVERAGES_AT].reshape(ROUGHNESSES, COSINES, 2).sum(axis=2)
    assert directional.max() <= 1.0 + 1e-9
    assert directional[0, 2:] == pytest.approx(1.0, abs=0.04)  # a mirror
    assert (np.diff(directional[:, -1]) < 1e-9).all()  # from above, less and less with roughness
    means = tables[AVERAGES_AT:].reshape(ROUGHNESSES, 2).sum(axis=1)
    assert (np.diff(means) < 0.0).all()


@pytest.mark.parametrize(
    ("material", "flag"),
    [
        (Material("m", opacity=0.3), GLASS),
        (Material("m", opacity=0.3, opacity_mode="presence"), COVERAGE),
        (Material("m", opacity=0.3, opacity_threshold=0.5), COVERAGE),
        (Material("m", opacity=0.3, ior=1.0), COVERAGE),
        (Material("m", opacity=TextureLookup(0, "a")), COVERAGE),
        (Material("m"), 0),
    ],
)
def test_opacity_mode_sets_flags(material: Material, flag: int) -> None:
    assert flags_of(material) & (GLASS | COVERAGE) == flag


@pytest.mark.parametrize(
    ("material", "matte"),
    [
        (Material("m", ior=1.0), True),
        (Material("m", use_specular_workflow=True), True),
        (Material("m"), False),
        (Material("m", ior=1.0, metallic=0.1), False),
        (Material("m", ior=1.0, clearcoat=0.1), False),
        (Material("m", ior=1.0, metallic=TextureLookup(0)), False),
    ],
)
def test_matte_flag_is_set_for_lambertian_materials(material: Material, matte: bool) -> None:
    assert bool(flags_of(material) & MATTE) == matte


@pytest.mark.parametrize(
    ("material", "may_mirror"),
    [
        (Material("m", metallic=1.0, roughness=0.0), True),
        (Material("m", metallic=1.0, roughness=0.2), False),
        (Material("m", metallic=1.0, roughness=TextureLookup(0, "r")), True),
        (Material("m", metallic=TextureLookup(0, "r"), roughness=0.1), True),
        (Material("m", metallic=0.5, roughness=0.1), False),
        (Material("m", metallic=1.0, roughness=0.0, opacity=0.3), False),  # glass
        (Material("m", metallic=1.0, roughness=0.0, use_specular_workflow=True), False),
        (Material("m", specular_color=(0.9, 0.6, 0.6), roughness=0.0, use_specular_workflow=True), True),
        (Material("m", specular_color=TextureLookup(0), roughness=0.0, use_specular_workflow=True), True),
    ],
)
def test_mirror_flag_is_set_for_smooth_materials(material: Material, may_mirror: bool) -> None:
    assert bool(flags_of(material) & MAY_MIRROR) == may_mirror


def test_textured_inputs_reach_the_lobes() -> None:
    pixels = np.full((4, 4, 4), 128, np.uint8)
    textured = Material(
        "m", diffuse_color=TextureLookup(0, scale=(1.0, 0.5, 0.0, 1.0), bias=(0.0, 0.0, 0.25, 0.0)), ior=1.0
    )
    up = np.array([[0.0, 0.0, 1.0]])
    for encoding, value in (("raw", 128 / 255), ("srgb", ((128 / 255 + 0.055) / 1.055) ** 2.4)):
        values = Bsdf(textured, (Texture("t", pixels, encoding=encoding),)).evaluate(up, up)
        assert values[0, :3] * math.pi == pytest.approx([value, 0.5 * value, 0.25], rel=1e-4)
