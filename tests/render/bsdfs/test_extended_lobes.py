# SPDX-License-Identifier: Apache-2.0
"""Extended lobes: samples against density, energy, reciprocity, closed forms, and no effect by default."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.reference.chi_square import (
    MIN_P_VALUE,
    SPHERE_HIGH,
    SPHERE_LOW,
    chi_square,
    directions_of,
    sphere_coordinates,
)
from tests.render.bsdfs.test_bsdf_properties import coated_material, directions, glass_material, random_material
from tests.render.bsdfs.test_bsdfs import COUNT, WHITE, numbers, outgoing
from tests.render.extended_shading import ExtendedBsdf
from tests.render.shading import Bsdf
from tiscene.scene.description import ExtendedLobes, Material, Texture, TextureLookup
from tiscene.scene.material_table import COVERAGE, EXTENDED, GLASS, MATTE, PLAIN, flags_of

BLACK = (0.0, 0.0, 0.0)
CLEAR = Material("m", WHITE, opacity=0.0, opacity_mode="transmission")
COLORED = ExtendedLobes(coat_color=(1.0, 0.5, 0.1))
CLOTH = ExtendedLobes(sheen_color=WHITE, sheen_roughness=0.3)
MATERIALS = {
    "brushed metal": Material("m", WHITE, metallic=1.0, roughness=0.6, lobes=ExtendedLobes(anisotropy=0.6)),
    "brushed plastic": Material("m", WHITE, roughness=0.6, lobes=ExtendedLobes(anisotropy=0.8, specular=0.5)),
    "cloth": Material("m", WHITE, roughness=0.8, lobes=CLOTH),
    "soft cloth": Material("m", BLACK, ior=1.0, lobes=replace(CLOTH, sheen_roughness=0.1)),
    "paper": Material("m", WHITE, roughness=0.6, lobes=ExtendedLobes(translucency=0.6)),
    "frosted pane": replace(CLEAR, roughness=0.6, lobes=ExtendedLobes(thin_walled=True)),
    "stained glass": replace(CLEAR, roughness=0.6, lobes=ExtendedLobes(transmission_color=(1.0, 0.5, 0.1))),
    "lacquer": Material("m", WHITE, roughness=0.7, clearcoat=1.0, clearcoat_roughness=0.5, lobes=COLORED),
}


def random_lobes(seed: int) -> ExtendedLobes:
    """Return random extended lobes, each of which has no effect in half of the cases."""
    random = np.random.default_rng((seed, 7))
    neutral = ExtendedLobes()

    def color(default: tuple[float, float, float]) -> tuple[float, float, float]:
        r, g, b = random.random(3).tolist()
        return (r, g, b) if random.random() < 0.5 else default

    def number(default: float) -> float:
        value = float(random.random())
        return value if random.random() < 0.5 else default

    return ExtendedLobes(
        transmission_color=color(WHITE),
        thin_walled=bool(random.random() < 0.5),
        sheen_color=color(BLACK),
        sheen_roughness=number(0.3),
        anisotropy=number(neutral.anisotropy),
        specular=number(1.0),
        specular_tint=color(WHITE),
        coat_color=color(WHITE),
        coat_ior=1.0 + number(0.5),
        translucency=number(0.0),
        translucent_color=color(WHITE),
    )


def albedo(bsdf: ExtendedBsdf, wo: np.ndarray, count: int = COUNT, eta: float = 1.0) -> np.ndarray:
    """Return the mean of f cos / density per channel; eta: index of refraction beyond a solid's surface."""
    incoming, values = bsdf.sample(np.tile(wo, (count, 1)), numbers(count))
    assert np.isfinite(values).all()
    assert (values >= 0.0).all()
    weight = np.divide(values[:, :3], values[:, 3:], out=np.zeros((count, 3)), where=values[:, 3:] > 0.0)
    mean: np.ndarray = (weight * np.where(incoming[:, 2:] < 0.0, eta * eta, 1.0)).mean(axis=0)
    return mean


@pytest.mark.parametrize("cosine", [0.25, 0.9])
@pytest.mark.parametrize("name", MATERIALS)
def test_directions_follow_density(name: str, cosine: float) -> None:
    bsdf = ExtendedBsdf(MATERIALS[name])
    incoming, values = bsdf.sample(outgoing(cosine), numbers())

    def density(coordinates: np.ndarray) -> np.ndarray:
        return bsdf.evaluate(outgoing(cosine, len(coordinates)), directions_of(coordinates))[:, 3]

    kept = values[:, 3] > 0.0
    assert np.abs(np.linalg.norm(incoming[kept], axis=1) - 1.0).max() < 1e-5
    coordinates = np.where(kept[:, None], sphere_coordinates(incoming.astype(np.float64)), 9.0)
    assert chi_square(coordinates, density, SPHERE_LOW, SPHERE_HIGH, (40, 24)) > MIN_P_VALUE


@pytest.mark.parametrize("name", ["cloth", "paper", "stained glass", "lacquer"])
def test_white_surfaces_return_all_light(name: str) -> None:
    """In the red channel, where all colors are 1."""
    material = MATERIALS[name]
    bsdf = ExtendedBsdf(material)
    for cosine in (0.05, 0.2, 0.5, 1.0):
        eta = material.ior if material.opacity == 0.0 else 1.0
        assert albedo(bsdf, outgoing(cosine, 1)[0], eta=eta)[0] == pytest.approx(1.0, abs=0.01), cosine


@pytest.mark.parametrize("make", [random_material, coated_material, glass_material])
def test_no_material_creates_energy(make) -> None:
    random = np.random.default_rng(4)
    for seed in range(12):
        material = replace(make(seed), lobes=random_lobes(seed), opacity_mode="transmission")
        front = bool(seed % 2)
        eta = 1.0 if material.lobes.thin_walled else material.ior if front else 1.0 / material.ior
        turn, cosine = random.uniform(0.0, 2.0 * math.pi), random.uniform(0.05, 1.0)
        level = math.sqrt(1.0 - cosine * cosine)
        wo = np.array([level * math.cos(turn), level * math.sin(turn), cosine])
        transmissive = material.opacity < 1.0
        found = albedo(ExtendedBsdf(material, front=front), wo, 20_000, eta if transmissive else 1.0)
        assert found.max() < 1.015, material


@pytest.mark.parametrize("name", ["brushed metal", "brushed plastic", "soft cloth"])
def test_reflection_is_reciprocal(name: str) -> None:
    bsdf, a, b = ExtendedBsdf(MATERIALS[name]), directions(1), directions(2)
    there, back = bsdf.evaluate(a, b)[:, :3] / b[:, 2:], bsdf.evaluate(b, a)[:, :3] / a[:, 2:]
    assert there.max() > 0.01
    np.testing.assert_allclose(there, back, rtol=2e-3, atol=1e-5)


def test_translucency_is_reciprocal_between_the_sides() -> None:
    bsdf, a, b = ExtendedBsdf(MATERIALS["paper"]), directions(1), directions(2)
    flip = np.array([1, 1, -1], np.float32)
    there, back = bsdf.evaluate(a, b * flip)[:, :3] / b[:, 2:], bsdf.evaluate(b, a * flip)[:, :3] / a[:, 2:]
    assert there.min() > 0.05
    np.testing.assert_allclose(there, back, rtol=2e-3)


@pytest.mark.parametrize("ior", [1.0, 1.5, 2.0])
def test_coat_reflects_by_its_index_of_refraction(ior: float) -> None:
    material = Material("m", BLACK, ior=1.0, clearcoat=1.0, clearcoat_roughness=0.1, lobes=ExtendedLobes(coat_ior=ior))
    found = albedo(ExtendedBsdf(material), outgoing(1.0, 1)[0])
    assert found == pytest.approx(((ior - 1.0) / (ior + 1.0)) ** 2, abs=2e-3)


@pytest.mark.parametrize("make", [random_material, coated_material, glass_material])
def test_default_lobes_have_no_effect(make) -> None:
    """The same values as the BSDF of UsdPreviewSurface."""
    for seed in range(4):
        material = make(seed)
        a, b = directions(seed), directions(seed + 50)
        b[::3, 2] *= -1.0
        plain = Bsdf(material).evaluate(a, b)
        extended = ExtendedBsdf(replace(material, lobes=ExtendedLobes())).evaluate(a, b)
        np.testing.assert_allclose(extended, plain, rtol=2e-4, atol=1e-6)


def test_anisotropic_highlight_has_openpbr_widths() -> None:
    """Seen from above, f falls to a quarter where the half vector's slope is alpha (to the masking)."""
    lobes = ExtendedLobes(anisotropy=0.75)
    bsdf = ExtendedBsdf(Material("m", WHITE, metallic=1.0, roughness=0.3, lobes=lobes))
    alpha_x = 0.09 * math.sqrt(2.0 / (1.0 + 0.25**2))
    for alpha, axis in ((alpha_x, 0), (0.25 * alpha_x, 1)):
        m = np.zeros(3)
        m[axis], m[2] = math.sin(math.atan(alpha)), math.cos(math.atan(alpha))
        wi = np.array([[0.0, 0.0, 1.0], 2.0 * m[2] * m - (0.0, 0.0, 1.0)])
        peak, there = bsdf.evaluate(outgoing(1.0, 2), wi)[:, 1]
        # D = D(0) / (4 cos^4 m); f cos is D F G / 4.
        assert there / peak == pytest.approx(0.25 / m[2] ** 4, rel=0.02)


def test_sheen_matches_the_paper() -> None:
    """Against a NumPy version of Estevez and Kulla's formulas."""
    r = 0.4
    lobes = ExtendedLobes(sheen_color=(1.0, 0.5, 0.0), sheen_roughness=r)
    bsdf = ExtendedBsdf(Material("m", BLACK, ior=1.0, lobes=lobes))
    a, b = directions(3).astype(float), directions(4).astype(float)
    m = (a + b) / np.linalg.norm(a + b, axis=1, keepdims=True)

    def fit(x: np.ndarray | float) -> np.ndarray:
        pairs = ((25.3245, 21.5473), (3.32435, 3.82987), (0.16801, 0.19823), (-1.27393, -1.9776), (-4.85967, -4.32054))
        ka, kb, kc, kd, ke = ((1 - r) ** 2 * p0 + (1 - (1 - r) ** 2) * p1 for p0, p1 in pairs)
        return np.asarray(ka / (1 + kb * x**kc) + kd * x + ke)

    def masking(cosine: np.ndarray) -> np.ndarray:
        return np.where(cosine < 0.5, np.exp(fit(cosine)), np.exp(2 * fit(0.5) - fit(1 - np.minimum(cosine, 1 - 1e-9))))

    density = (2 + 1 / r) * np.sqrt(1 - m[:, 2] ** 2) ** (1 / r) / (2 * math.pi)
    expected = density / (1 + masking(a[:, 2]) + masking(b[:, 2])) / (4 * a[:, 2])
    values = bsdf.evaluate(a, b)
    np.testing.assert_allclose(values[:, 0], expected, rtol=2e-3, atol=1e-6)
    np.testing.assert_allclose(values[:, 1], 0.5 * expected, rtol=2e-3, atol=1e-6)
    assert values[:, 2].max() == 0.0


def test_pane_transmits_straight_with_reflections_between_its_sides() -> None:
    """At normal incidence 2 F / (1 + F) = 2 * 0.04 / 1.04 is reflected; the rest has the color."""
    lobes = ExtendedLobes(thin_walled=True, transmission_color=(1.0, 0.5, 0.0))
    bsdf = ExtendedBsdf(replace(CLEAR, roughness=0.0, lobes=lobes))
    wo = outgoing(1.0)
    incoming, values = bsdf.sample(wo, numbers())
    through = incoming[:, 2] < 0.0
    assert through.mean() == pytest.approx(1.0 - 0.08 / 1.04, abs=0.005)
    assert np.median(np.abs(incoming[through] + wo[through]).max(axis=1)) < 0.002
    weight = values[:, :3] / np.maximum(values[:, 3:], 1e-30)
    assert weight[through].mean(axis=0) == pytest.approx([1.0, 0.5, 0.0], abs=0.01)
    assert weight[~through].mean(axis=0) == pytest.approx([1.0, 1.0, 1.0], abs=0.01)


def test_specular_weight_and_tint_scale_the_dielectric_reflectance() -> None:
    """A black dielectric, seen and lit from above; the lobe is that of weight 1 times F0's factors."""
    black = Material("m", BLACK, roughness=0.1)
    up = outgoing(1.0, 1)
    full = Bsdf(black).evaluate(up, up)[0, :3]
    tinted = ExtendedBsdf(replace(black, lobes=ExtendedLobes(specular=0.5, specular_tint=(1.0, 0.5, 4.0))))
    np.testing.assert_allclose(tinted.evaluate(up, up)[0, :3], full * (0.5, 0.25, 2.0), rtol=1e-3)


def test_textured_inputs_reach_the_lobes() -> None:
    pixels = np.tile(np.array([64, 128, 255, 255], np.uint8), (4, 4, 1))
    image = (Texture("t", pixels, encoding="raw"),)
    up, level = outgoing(1.0, 1), outgoing(0.3, 1)
    lookup, red = TextureLookup(0), TextureLookup(0, "r")
    values = (64 / 255, 128 / 255, 1.0)
    for name, textured, constant in (
        ("sheen_color", lookup, values),
        ("sheen_roughness", red, 64 / 255),
        ("anisotropy", red, 64 / 255),
        ("specular", red, 64 / 255),
        ("specular_tint", lookup, values),
        ("coat_color", lookup, values),
        ("translucency", red, 64 / 255),
        ("translucent_color", lookup, values),
    ):
        lobes = ExtendedLobes(sheen_color=(0.5, 0.5, 0.5), translucency=0.5)
        base = Material("m", (0.5, 0.5, 0.5), roughness=0.3, clearcoat=1.0)
        found, expected = (
            ExtendedBsdf(replace(base, lobes=replace(lobes, **{name: value})), image) for value in (textured, constant)
        )
        for wi in (up, level, level * (1, 1, -1)):
            np.testing.assert_allclose(found.evaluate(level, wi), expected.evaluate(level, wi), rtol=1e-3, err_msg=name)


@pytest.mark.parametrize(
    ("material", "flags"),
    [
        (Material("m", ior=1.0, lobes=ExtendedLobes()), EXTENDED),
        (Material("m", ior=1.0), MATTE | PLAIN),
        (CLEAR, GLASS),
        (replace(CLEAR, opacity=TextureLookup(0, "r")), GLASS),
        (replace(CLEAR, ior=1.0), COVERAGE | MATTE),  # nothing refracts
        (replace(CLEAR, ior=1.0, lobes=ExtendedLobes(thin_walled=True)), GLASS | EXTENDED),
    ],
)
def test_flags_of_extended_materials(material: Material, flags: int) -> None:
    assert flags_of(material) & (EXTENDED | MATTE | PLAIN | GLASS | COVERAGE) == flags
