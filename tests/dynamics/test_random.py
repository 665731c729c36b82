# SPDX-License-Identifier: Apache-2.0
"""Random numbers against their claimed distributions, by Kolmogorov-Smirnov and chi-square tests."""

import numpy as np
import pytest
import taichi as ti
from scipy import stats

from dynamics.random import ball, hemisphere, pcg4d, uniform4

COUNT = 40_000
SIGNIFICANCE = 1e-4  # the numbers are fixed, so that a test that passes once always passes

Table = ti.types.ndarray(ti.f64, 2)


@ti.kernel
def draw(seed: ti.i32, number: ti.i32, uniforms: Table, directions: Table, spins: Table, normal: Table):
    for i in range(uniforms.shape[0]):
        u = uniform4(seed, number, i, 0)
        up = ti.Vector([normal[0, 0], normal[0, 1], normal[0, 2]])
        direction = hemisphere(up, u[0], u[1])
        v = uniform4(seed, number, i, 1)
        spin = ball(v[0], v[1], v[2])
        for c in ti.static(range(4)):
            uniforms[i, c] = u[c]
        for c in ti.static(range(3)):
            directions[i, c] = direction[c]
            spins[i, c] = spin[c]


@ti.kernel
def hash_words(counters: ti.types.ndarray(ti.u32, 2), result: ti.types.ndarray(ti.u32, 2)):
    for i in range(counters.shape[0]):
        hashed = pcg4d(counters[i, 0], counters[i, 1], counters[i, 2], counters[i, 3])
        for c in ti.static(range(4)):
            result[i, c] = hashed[c]


def drawn(seed=42, number=7, normal=(0.0, 0.0, 1.0)):
    uniforms, directions, spins = np.zeros((COUNT, 4)), np.zeros((COUNT, 3)), np.zeros((COUNT, 3))
    draw(seed, number, uniforms, directions, spins, np.array([normal]))
    return uniforms, directions, spins


def test_pcg4d_matches_numpy_version_of_published_function():
    """Includes integer overflow."""
    counters = np.random.default_rng(1).integers(0, 2**32, (100, 4), dtype=np.uint32)
    result = np.zeros_like(counters)
    hash_words(counters, result)
    v = counters * np.uint32(1664525) + np.uint32(1013904223)
    for _ in range(2):
        for target, a, b in ((0, 1, 3), (1, 2, 0), (2, 0, 1), (3, 1, 2)):
            v[:, target] += v[:, a] * v[:, b]
        v ^= v >> np.uint32(16)
    np.testing.assert_array_equal(result, v)


@pytest.mark.parametrize(("seed", "number"), [(42, 7), (0, 0), (2**31 - 1, -5)])
def test_uniform4_is_uniform_and_uncorrelated(seed, number):
    uniforms, _, _ = drawn(seed, number)
    assert uniforms.min() > 0.0
    assert uniforms.max() < 1.0
    for column in uniforms.T:
        assert stats.kstest(column, "uniform").pvalue > SIGNIFICANCE
        # Neighboring bounces are independent: pairs fill the unit square evenly.
        pairs, _, _ = np.histogram2d(column[0::2], column[1::2], bins=16, range=[[0, 1], [0, 1]])
        assert stats.chisquare(pairs.ravel()).pvalue > SIGNIFICANCE
    correlation = np.corrcoef(uniforms.T)
    np.testing.assert_allclose(correlation, np.eye(4), atol=5.0 / np.sqrt(COUNT))


def test_other_bodies_and_seeds_have_uncorrelated_numbers():
    first = drawn(42, 7)[0][:, 0]
    for seed, number in ((42, 8), (43, 7), (7, 42)):
        other = drawn(seed, number)[0][:, 0]
        assert abs(np.corrcoef(first, other)[0, 1]) < 5.0 / np.sqrt(COUNT)


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.6, -0.48, 0.64), (-0.8, 0.0, 0.6)])
def test_hemisphere_is_uniform_about_any_normal(normal):
    _, directions, _ = drawn(normal=normal)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-6)
    heights = directions @ normal
    assert heights.min() > 0.0
    assert stats.kstest(heights, "uniform").pvalue > SIGNIFICANCE
    # The centroid of a uniform hemisphere is half the normal, and the angle about the normal is uniform.
    np.testing.assert_allclose(directions.mean(axis=0), 0.5 * np.array(normal), atol=5.0 / np.sqrt(COUNT))
    tangent = np.cross(normal, (0.3, 0.9, -0.2))
    tangent /= np.linalg.norm(tangent)
    angle = np.arctan2(directions @ np.cross(normal, tangent), directions @ tangent)
    assert stats.kstest(angle / (2.0 * np.pi) + 0.5, "uniform").pvalue > SIGNIFICANCE


def test_ball_is_uniform():
    _, _, spins = drawn()
    lengths = np.linalg.norm(spins, axis=1)
    assert lengths.max() < 1.0 + 1e-6
    assert stats.kstest(lengths**3, "uniform").pvalue > SIGNIFICANCE
    for axis in np.eye(3):
        assert stats.kstest(0.5 * (spins @ axis) / lengths + 0.5, "uniform").pvalue > SIGNIFICANCE
