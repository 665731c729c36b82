# SPDX-License-Identifier: Apache-2.0
"""Buffers as images: color maps, limits and legends."""

import numpy as np
import pytest

from tests.export.fake_stream import fake_buffer
from tiscene.frame import visualize
from tiscene.frame.buffers import BUFFERS
from tiscene.frame.visualize import BACKGROUND, picture


@pytest.mark.parametrize("name", BUFFERS)
def test_every_buffer_has_an_image(name):
    shown = picture(name, fake_buffer(name, 1, 40, 30))
    assert shown.image.shape == (30, 40, 3)
    assert shown.image.dtype == np.uint8
    assert shown.caption
    assert len(np.unique(shown.image.reshape(-1, 3), axis=0)) > 1


@pytest.mark.parametrize("name", [name for name, aov in BUFFERS.items() if aov.background is not None])
def test_buffer_of_background_alone_has_a_uniform_image(name):
    aov = BUFFERS[name]
    image = picture(name, np.full(aov.shape(6, 4), aov.background, aov.dtype)).image
    assert image.shape == (4, 6, 3)
    assert (image == image[0, 0]).all()


def luminance(colors):
    linear = (np.asarray(colors) / 255.0) ** 2.2
    return linear @ (0.2126, 0.7152, 0.0722)


def test_sequential_colors_rise_in_luminance():
    ramp = visualize.sequential(np.linspace(0.0, 1.0, 64))
    assert (np.diff(luminance(ramp)) > 0).all()
    assert luminance(ramp[0]) < 0.03
    assert luminance(ramp[-1]) > 0.75


def test_depth_image_is_brighter_nearby_and_background_without_a_hit():
    image = visualize.depth_picture(np.array([[1.0, 3.0, np.inf]]), 1.0, 3.0)
    assert luminance(image[0, 0]) > luminance(image[0, 1])
    assert tuple(image[0, 2]) == BACKGROUND


def test_flow_image_has_the_hues_of_the_wheel():
    flow = np.array([[[1, 0], [0, 1], [-1, 0], [0, -1], [0, 0], [0.5, 0], [np.nan, 0]]], np.float32)
    right, down, left, up, still, half, invalid = visualize.flow_picture(flow, 1.0, legend=False)[0].tolist()
    assert right == [255, 0, 0]
    assert [down[0], down[2]] == [255, 0]
    assert 150 < down[1] < 255
    assert [left[0], left[2]] == [0, 255]
    assert left[1] > 200
    assert up[1:] == [0, 255]
    assert up[0] > 80
    assert still == [255, 255, 255]
    assert half == [255, 128, 128]
    assert invalid == [0, 0, 0]


def test_legend_of_flow_is_in_the_lower_right_corner():
    still = np.zeros((90, 120, 2), np.float32)
    plain, marked = (visualize.flow_picture(still, 1.0, legend=legend) for legend in (False, True))
    y, x = np.nonzero((plain != marked).any(axis=2))
    assert y.min() >= 65
    assert x.min() >= 95
    center = ((y.min() + y.max()) // 2, (x.min() + x.max()) // 2)
    assert tuple(marked[center]) == (255, 255, 255)


def test_id_colors_are_fixed_and_distinct():
    colors = visualize.id_colors(np.arange(0, 41)).astype(int)
    assert tuple(colors[0]) == BACKGROUND
    apart = np.abs(colors[:, None] - colors[None]).max(axis=2) + 1000 * np.eye(41, dtype=int)
    assert apart.min() > 10
    neighbors = np.abs(np.diff(colors[1:], axis=0)).max(axis=1)
    assert neighbors.min() > 60
    ids = np.array([[0, 7], [7, 40]], np.int32)
    np.testing.assert_array_equal(visualize.id_picture(ids), colors[ids])
    assert visualize.id_picture(np.array([[2**31 - 1]], np.int32)).shape == (1, 1, 3)


def test_limits_of_several_frames_ignore_the_background():
    frames = [np.array([[1.0, np.inf]], np.float32), np.array([[3.0, np.inf]], np.float32)]
    low, high = visualize.limits_of("depth", frames)
    assert 1.0 <= low < 1.1
    assert 2.9 < high <= 3.0
    flow = np.array([[[3.0, 4.0], [np.nan, 0.0]]], np.float32)
    assert visualize.limits_of("forward_flow", [flow]) == (0.0, 5.0)
    assert visualize.limits_of("depth", [np.full((2, 2), np.inf, np.float32)]) == (0.0, 1.0)


def test_oklch_matches_known_colors():
    assert visualize.oklch(1.0, 0.0, 0.0).tolist() == [255, 255, 255]
    assert visualize.oklch(0.0, 0.0, 0.0).tolist() == [0, 0, 0]
    # sRGB red is L 0.628, C 0.2577, h 29.23 degrees.
    np.testing.assert_allclose(visualize.oklch(0.62796, 0.25768, np.radians(29.234)), [255, 0, 0], atol=1)
