# SPDX-License-Identifier: Apache-2.0
"""Paintings, prints, book spines and pages, a laptop's screen: images of whole objects rather than materials."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usd_scenes.author.textures.noise import mix, smoothstep, spectral

Array = NDArray[np.float64]


def landscape(width: int, height: int, seed: int, light: tuple[float, float, float] = (0.92, 0.70, 0.36)) -> Array:
    """Generate an oil sketch of hazy hills and a lake under an evening sky; `light` is the color of the sun."""
    shape = (height, width)
    y, x = np.mgrid[0:height, 0:width]
    v, u = 1.0 - (y + 0.5) / height, (x + 0.5) / width
    low = 0.25 * np.array(light) + 0.6 * np.array((0.72, 0.42, 0.20))
    sky = mix(np.broadcast_to(low, (*shape, 3)), (0.16, 0.28, 0.42), smoothstep(0.45, 1.0, v))
    clouds = spectral(shape, seed + 1, (0.05, 0.22), slope=1.6)
    picture = mix(sky, (0.80, 0.60, 0.42), 0.75 * smoothstep(0.3, 1.6, clouds) * smoothstep(0.45, 0.7, v))
    rng = np.random.default_rng(seed)
    halo = np.exp(-(((u - rng.uniform(0.3, 0.7)) / 0.16) ** 2) - ((v - 0.52) / 0.07) ** 2)
    picture = mix(picture, light, halo)
    tones = ((0.26, 0.27, 0.33), (0.14, 0.18, 0.22), (0.075, 0.11, 0.085), (0.06, 0.065, 0.03))
    for layer, (level, tone) in enumerate(zip((0.50, 0.43, 0.35, 0.16), tones, strict=True)):
        phases = rng.uniform(0.0, 2.0 * np.pi, 6)
        waves = sum(0.05 / (n + 1) * np.sin((n + 1.3) * 3.1 * u + phases[n]) for n in range(6))
        ridge = level + waves * (1.0 - 0.1 * layer)
        shade = np.exp(0.25 * spectral(shape, seed + 10 + layer, (0.03, 0.10), slope=1.4))[..., None]
        picture = mix(picture, shade * tone, smoothstep(-0.008, 0.008, ridge - v))
    lake = smoothstep(0.27, 0.255, v) * smoothstep(0.14, 0.15, v + 0.04 * np.sin(5.0 * u + 1.0))
    picture = mix(picture, (0.45, 0.38, 0.33), 0.8 * lake * smoothstep(-1.0, 1.0, np.roll(clouds, 30, axis=0)))
    return _brushed(picture, seed).clip(0.02, 0.85)


def _brushed(picture: Array, seed: int) -> Array:
    """Repaint a picture with brush strokes, broad ones first, each of the color at its middle."""
    height, width = picture.shape[:2]
    rng = np.random.default_rng(seed)
    canvas = picture.copy()
    for long, wide, count in ((60.0, 15.0, 1500), (34.0, 9.0, 5000), (18.0, 4.5, 9000)):
        length, breadth = long * width / 768.0, wide * width / 768.0
        reach = int(length / 2.0) + 2
        dy, dx = np.mgrid[-reach : reach + 1, -reach : reach + 1]
        for row, column in zip(rng.integers(0, height, count), rng.integers(0, width, count), strict=True):
            turn = rng.normal(0.0, 0.22) + 0.35 * np.sin(5.0 * column / width) * (row < 0.5 * height)
            along, across = np.cos(turn) * dx + np.sin(turn) * dy, np.cos(turn) * dy - np.sin(turn) * dx
            bristles = 0.75 + 0.25 * np.sin(across * 2.4 + rng.uniform(0.0, 6.3))
            edge = np.maximum(np.abs(along) / (length / 2.0), np.abs(across) / (breadth / 2.0))
            cover = bristles * smoothstep(1.0, 0.8, edge)
            rows, columns = row + dy[:, 0], column + dx[0]
            upright, sideways = (rows >= 0) & (rows < height), (columns >= 0) & (columns < width)
            at = np.ix_(rows[upright], columns[sideways])
            color = picture[row, column] * np.exp(rng.normal(0.0, 0.07) + rng.normal(0.0, 0.03, 3))
            canvas[at] = mix(canvas[at], color, cover[np.ix_(upright, sideways)])
    return canvas


def sprig(width: int, height: int, seed: int) -> Array:
    """Generate a pressed twig with paired leaves, in ink and wash on paper."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:height, 0:width]
    u, v = (x + 0.5) / height - 0.5 * width / height, 1.0 - (y + 0.5) / height
    grain = spectral((height, width), seed, 0.02, slope=1.2)
    wash = spectral((height, width), seed + 1, 0.10, slope=1.8)
    picture = np.broadcast_to((0.70, 0.67, 0.60), (height, width, 3))
    bend = rng.uniform(-0.10, 0.10)

    def stem(t: Array | float) -> Array | float:
        return bend * np.sin(2.2 * np.asarray(t)) + 0.02 * np.sin(9.0 * np.asarray(t))

    ink = (0.085, 0.115, 0.075)
    inside = (v > 0.10) & (v < 0.90)
    picture = mix(picture, ink, smoothstep(0.0045, 0.0025, np.abs(u - stem(v))) * inside)
    pairs = int(rng.integers(7, 10))
    for index, level in enumerate(np.linspace(0.24, 0.88, pairs)):
        for side in (-1.0, 1.0):
            size = 0.17 * (1.0 - 0.55 * index / pairs) * rng.uniform(0.9, 1.1)
            turn = np.radians(rng.uniform(28.0, 46.0))
            p, q = side * (u - stem(level)), v - level
            along = (p * np.cos(turn) + q * np.sin(turn)) / size
            across = (q * np.cos(turn) - p * np.sin(turn)) / size
            half = 0.23 * np.sin(np.pi * along.clip(0.0, 1.0) ** 0.8)
            blade = smoothstep(0.012, -0.012, np.abs(across - 0.10 * along * (1.0 - along)) - half) * (along > 0.0)
            tone = np.array((0.16, 0.24, 0.15)) * rng.uniform(0.75, 1.3)
            picture = mix(picture, tone * np.exp(0.18 * wash)[..., None], 0.88 * blade * (along < 1.0))
            picture = mix(picture, ink, 0.5 * smoothstep(0.02, 0.008, np.abs(across)) * blade)
    return np.asarray(picture * np.exp(0.03 * grain)[..., None]).clip(0.02, 0.85)


def arches(width: int, height: int, seed: int) -> Array:
    """Generate nested arches over a disc, block printed: dry edges and a little paper showing through."""
    y, x = np.mgrid[0:height, 0:width]
    worn = spectral((height, width), seed, 0.012, slope=1.0)
    edge = 0.0025 * spectral((height, width), seed + 1, 0.04, slope=1.6)
    u, v = (x + 0.5) / height - 0.5 * width / height, 1.0 - (y + 0.5) / height
    picture = np.broadcast_to((0.70, 0.66, 0.58), (height, width, 3))
    bands = (
        (0.27, (0.10, 0.19, 0.19)),
        (0.205, (0.56, 0.33, 0.19)),
        (0.14, (0.62, 0.52, 0.38)),
        (0.075, (0.33, 0.11, 0.06)),
    )
    for radius, color in bands:
        reach = np.where(v > 0.46, np.hypot(u, v - 0.46), np.abs(u)) + edge
        ring = smoothstep(0.0015, -0.0015, reach - radius) * (v > 0.16) * smoothstep(-2.4, -1.6, worn)
        picture = mix(picture, (0.70, 0.66, 0.58), smoothstep(0.0015, -0.0015, reach - radius - 0.010) * (v > 0.15))
        picture = mix(picture, color, 0.95 * ring)
    disc = smoothstep(0.0015, -0.0015, np.hypot(u - 0.13, v - 0.84) + edge - 0.062) * smoothstep(-2.4, -1.6, worn)
    return np.asarray(mix(picture, (0.60, 0.40, 0.12), 0.95 * disc)).clip(0.02, 0.85)


def abstract(width: int, height: int, seed: int, palette: list[tuple[float, float, float]]) -> Array:
    """Generate soft-edged fields of color and a few arcs on a pale ground, on paper."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:height, 0:width]
    u, v = (x + 0.5) / height, (y + 0.5) / height
    grain = spectral((height, width), seed, 0.02, slope=1.2)
    edge = 0.010 * spectral((height, width), seed + 1, 0.05, slope=1.6)
    picture = np.broadcast_to((0.70, 0.66, 0.58), (height, width, 3))
    for index, color in enumerate(palette):
        cx, cy = rng.uniform(0.15, 0.85) * width / height, 0.14 + 0.72 * (index + 0.5) / len(palette)
        a, b, turn = rng.uniform(0.16, 0.34), rng.uniform(0.10, 0.22), rng.uniform(-0.6, 0.6)
        p = np.cos(turn) * (u - cx) + np.sin(turn) * (v - cy)
        q = -np.sin(turn) * (u - cx) + np.cos(turn) * (v - cy)
        inside = 1.0 - ((np.abs(p) / a) ** 2.6 + (np.abs(q) / b) ** 2.6) + edge * 4.0
        picture = mix(picture, color, 0.93 * smoothstep(-0.03, 0.03, inside))
    for _ in range(3):
        cx, cy, radius = rng.uniform(0.2, 0.8) * width / height, rng.uniform(0.2, 0.8), rng.uniform(0.12, 0.36)
        ring = np.abs(np.hypot(u - cx, v - cy) + 0.5 * edge - radius)
        start = np.arctan2(v - cy, u - cx) > rng.uniform(-2.5, 0.5)
        picture = mix(picture, (0.035, 0.035, 0.04), smoothstep(0.007, 0.004, ring) * start)
    return np.asarray(picture * np.exp(0.035 * grain)[..., None]).clip(0.02, 0.85)


def spines(size: int, seed: int, count: int) -> Array:
    """Generate `count` book spines side by side: colored cloth, bands, and a title in worn foil."""
    rng = np.random.default_rng(seed)
    cloths = [
        (0.30, 0.055, 0.045), (0.05, 0.085, 0.17), (0.055, 0.12, 0.085), (0.42, 0.30, 0.13), (0.60, 0.55, 0.46),
        (0.045, 0.045, 0.05), (0.36, 0.15, 0.055), (0.12, 0.20, 0.24), (0.50, 0.42, 0.30), (0.20, 0.045, 0.09),
        (0.68, 0.64, 0.57), (0.16, 0.19, 0.12), (0.085, 0.055, 0.045), (0.55, 0.22, 0.10), (0.26, 0.31, 0.35),
        (0.62, 0.48, 0.20),
    ]  # fmt: skip
    edges = np.round(np.linspace(0, size, count + 1)).astype(int)
    picture = np.zeros((size, size, 3))
    for index in range(count):
        width = int(edges[index + 1] - edges[index])
        y, x = np.mgrid[0:size, 0:width]
        v, u = 1.0 - (y + 0.5) / size, (x + 0.5) / width
        cloth = np.array(cloths[index % len(cloths)])
        dark = cloth.mean() < 0.25
        foil = (
            np.array((0.62, 0.47, 0.20))
            if dark and rng.random() < 0.6
            else np.array((0.66, 0.62, 0.54) if dark else (0.06, 0.05, 0.05))
        )
        spine = np.broadcast_to(cloth, (size, width, 3))
        worn = smoothstep(-0.5, 0.8, spectral((size, width), seed + index, 0.05, slope=1.0))
        ink = np.zeros((size, width))
        for level in (0.06, 0.085, 0.90) if rng.random() < 0.6 else (0.94,):
            ink = np.maximum(ink, np.abs(v - level) < 0.004)
        low, high = (0.42, 0.84) if rng.random() < 0.7 else (0.3, 0.7)
        letters = np.repeat(rng.random(60) < 0.78, 2)[(v * 119).astype(int)]
        strokes = np.repeat(rng.random((120, 5)) < 0.62, 1, axis=0)[(v * 119).astype(int), (u * 4.999).astype(int)]
        ink = np.maximum(ink, letters * strokes * (v > low) * (v < high) * (np.abs(u - 0.5) < 0.24))
        ink = np.maximum(ink, (np.hypot((v - 0.14) * size / width / 4.2, u - 0.5) < 0.16) * 1.0)
        fade = np.exp(0.05 * spectral((size, width), seed + 50 + index, 0.2, slope=1.2))
        picture[:, edges[index] : edges[index + 1]] = mix(spine, foil, ink * (0.55 + 0.4 * worn)) * fade[..., None]
    return picture


def pages(size: int, seed: int) -> Array:
    """Generate the cut edge of a block of paper; the sheets lie along u."""
    sheets = spectral((size, size), seed, (0.006, 3.0), slope=0.8)
    return np.asarray((0.66, 0.60, 0.49) * np.exp(0.10 * sheets)[..., None])


def screen(width: int, height: int, seed: int) -> Array:
    """Generate a desktop: a gradient of dunes with a dock of icons; linear, also used as emission."""
    y, x = np.mgrid[0:height, 0:width]
    u, v = (x + 0.5) / width, 1.0 - (y + 0.5) / height
    picture = mix(np.broadcast_to((0.62, 0.30, 0.14), (height, width, 3)), (0.05, 0.16, 0.38), smoothstep(0.3, 1.0, v))
    rng = np.random.default_rng(seed)
    for layer in range(5):
        level, phase = 0.52 - 0.11 * layer, rng.uniform(0.0, 6.3)
        ridge = level + 0.07 * np.sin(3.0 * u + phase) + 0.04 * np.sin(7.0 * u - 1.7 * phase)
        tone = mix((0.30, 0.14, 0.20), (0.02, 0.05, 0.13), np.full((height, width), layer / 4.0))
        picture = mix(picture, tone, smoothstep(-0.004, 0.004, ridge - v))
    dock = (np.abs(u - 0.5) < 0.30) * (v > 0.03) * (v < 0.115)
    picture = mix(picture, (0.55, 0.57, 0.60), 0.45 * dock)
    icons = [
        (0.75, 0.12, 0.08),
        (0.08, 0.35, 0.75),
        (0.10, 0.55, 0.20),
        (0.80, 0.60, 0.08),
        (0.45, 0.15, 0.60),
        (0.7, 0.7, 0.7),
    ]
    for index, color in enumerate(icons):
        center = 0.5 + (index - 2.5) * 0.09
        inside = np.maximum(np.abs(u - center) * width / height, np.abs(v - 0.0725)) < 0.030
        picture = mix(picture, color, inside * 1.0)
    bar = v > 0.968
    return np.asarray(mix(picture, (0.04, 0.04, 0.05), 0.7 * bar))


def scribble(size: int, seed: int) -> Array:
    """Generate a child's painting on white cotton: a yellow disc and brush lines in red, blue and green."""
    y, x = np.mgrid[0:size, 0:size]
    wobble = 0.012 * spectral((size, size), seed, 0.30, slope=3.0)
    u, v = (x + 0.5) / size + wobble, (y + 0.5) / size + np.roll(wobble, 9, axis=0)
    picture = np.broadcast_to((0.70, 0.68, 0.63), (size, size, 3))
    picture = mix(picture, (0.74, 0.55, 0.03), smoothstep(0.19, 0.18, np.hypot(u - 0.42, v - 0.67)))
    rng = np.random.default_rng(seed)
    colors = [(0.60, 0.035, 0.03), (0.035, 0.07, 0.42), (0.04, 0.30, 0.07), (0.60, 0.035, 0.03), (0.35, 0.05, 0.33)] * 2
    for color in colors:
        start, end = rng.uniform(0.05, 0.95, 2), rng.uniform(0.05, 0.95, 2)
        bend, width = rng.normal(0.0, 0.25, 2), rng.uniform(0.012, 0.024)
        nearest = np.full((size, size), 9.0)
        for t in np.linspace(0.0, 1.0, 160):
            point = start + t * (end - start) + np.sin(np.pi * t) * bend
            nearest = np.minimum(nearest, np.hypot(u - point[0], v - point[1]))
        picture = mix(picture, color, 0.92 * smoothstep(width + 0.004, width - 0.004, nearest))
    return np.asarray(picture)
