# SPDX-License-Identifier: Apache-2.0
"""Tubes and ribbons along polylines, of their full width up to the joints at their bends.

A joint is mitred: the cross section lies in the plane halfway between its two segments. At sharper bends, and where it
would reach beyond a segment, each segment of a line ends in a cross section of its own, with a bevel between the two.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.usd.geometry.triangulate import cross
from tiscene.usd.geometry.vertex_weld import WeldedMesh

Floats = NDArray[np.floating]
Start = tuple[Floats, Floats]  # unit direction of the first segment of curves, and a perpendicular of it, [c, 3] each
_MITRE = math.cos(math.radians(45.0))  # of half the angle of the sharpest bend that is a mitred joint
_SMOOTH = math.cos(math.radians(15.0))  # of half the angle of the sharpest bend of lines that is shaded smoothly


@dataclass(frozen=True, eq=False)
class Strip:
    """Curves of one vertex count at m samples each.

    Attributes:
        line: [c, m, 3].
        width: [c, m].
        normal: [c, m, 3]; None: tubes.
        values: [c, m, 2 or 8], the columns of `primvar.read_vertex_values`; None: none are read.
        curve_ids: [c], the curves among all.
    """

    line: Floats
    width: Floats
    normal: Floats | None
    values: Floats | None
    curve_ids: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class _Sections:
    """Cross sections of shapes that are swept along polylines, each at an end of a segment.

    Attributes:
        sample: [r], the sample of the curves that each is at.
        segment: [r], the segment that it ends.
        along: [c, r, 3], unit direction of that segment.
        plane: [c, r, 3], sum of the unit directions before and after the sample.
        is_cut: bool [c, r], whether it is in the plane halfway between the directions, as of a mitred joint.
        is_smooth: bool [c, r], whether shading is continuous there.
    """

    sample: NDArray[np.int64]
    segment: NDArray[np.int64]
    along: Floats
    plane: Floats
    is_cut: NDArray[np.bool_]
    is_smooth: NDArray[np.bool_]

    def place(self, line: Floats, offsets: Floats) -> Floats:
        """Return points at offsets [c, r, p, 3] from polylines, across the segments up to the planes of the joints."""
        squared = np.maximum(np.einsum("crk,crk->cr", self.plane, self.plane) / 4.0, _MITRE**2)
        depth = -np.einsum("crpk,crk->crp", offsets, self.plane) / (2.0 * squared)[..., None]
        offsets = offsets + np.where(self.is_cut[..., None], depth, 0.0)[..., None] * self.along[:, :, None]
        result = line[:, self.sample][:, :, None] + offsets
        same = self.is_cut[:, 1:] & (self.sample[1:] == self.sample[:-1])  # both sides of a joint, to the bit
        return np.concatenate([result[:, :1], np.where(same[..., None, None], result[:, :-1], result[:, 1:])], axis=1)

    def shading(self, outward: Floats) -> Floats:
        """Return unit normals [c, r, p, 3] from those across the segments."""
        flat = outward - _along(outward, self.plane[:, :, None])
        flat = flat / np.maximum(np.linalg.norm(flat, axis=-1, keepdims=True), 1e-30)
        return np.asarray(np.where(self.is_smooth[..., None, None], flat, outward))


def _along(vectors: Floats, axis: Floats) -> Floats:
    """Return the parts of vectors along an axis of any length; zeros for one of length 0."""
    squared = np.maximum(np.einsum("...k,...k->...", axis, axis), 1e-30)
    return np.asarray((np.einsum("...k,...k->...", vectors, axis) / squared)[..., None] * axis)


def _directions(line: Floats) -> Floats:
    """Return the unit directions of the segments of polylines: [c, m - 1, 3]. Empty ones have that before them."""
    steps = np.diff(line, axis=1)
    length = np.linalg.norm(steps, axis=-1)
    before = np.maximum.accumulate(np.where(length > 0.0, np.arange(steps.shape[1]), -1), axis=1)
    row = np.where(before < 0, np.argmax(length > 0.0, axis=1)[:, None], before)
    steps, length = np.take_along_axis(steps, row[..., None], axis=1), np.take_along_axis(length, row, axis=1)
    return np.where(length[..., None] > 0.0, steps / np.maximum(length, 1e-300)[..., None], (0.0, 0.0, 1.0))


def _sections(strip: Strip, corners: bool, closed: bool) -> _Sections:
    """Return the cross sections of a strip's curves.

    Args:
        strip: the curves.
        corners: whether each segment has two of its own, so that joints may be creased and open; else they are shared.
        closed: whether the last sample is the first.
    """
    direction = _directions(strip.line)
    segments = direction.shape[1]
    segment = np.repeat(np.arange(segments), 2) if corners else np.maximum(np.arange(segments + 1) - 1, 0)
    sample = segment + np.arange(2 * segments) % 2 if corners else np.arange(segments + 1)
    before, after = sample - 1, sample
    if closed:
        before, after = before % segments, after % segments
    before, after = direction[:, np.maximum(before, 0)], direction[:, np.minimum(after, segments - 1)]
    along, plane = direction[:, segment], before + after
    cosine = np.minimum(np.linalg.norm(plane, axis=-1) / 2.0, 1.0)
    reach = 0.5 * strip.width[:, sample] * np.sqrt(1.0 - cosine**2)
    length = np.linalg.norm(np.diff(strip.line, axis=1), axis=-1)
    shorter = np.minimum(length[:, np.maximum(sample - 1, 0)], length[:, np.minimum(sample, segments - 1)])
    is_cut = (cosine >= _MITRE) & (reach <= shorter * cosine) if corners else np.ones(cosine.shape, bool)
    return _Sections(sample, segment, along, plane, is_cut, (cosine >= _SMOOTH) | (not corners))


def _frames(direction: Floats, start: Start | None) -> tuple[Floats, Floats]:
    """Return two unit perpendiculars of directions [c, s, 3] that turn as little as possible from each to the next.

    The first ones turn as little as possible from `start`.
    """
    side = np.empty_like(direction)
    before, across = start or (direction[:, 0], np.eye(3)[np.argmin(np.abs(direction[:, 0]), axis=-1)])
    for step in range(direction.shape[1]):
        t = direction[:, step]
        turn = 1.0 + np.einsum("ck,ck->c", before, t)  # 0 if it turns back
        back = np.einsum("ck,ck->c", across, t) / np.where(turn > 1e-9, turn, 1.0)
        across = across - np.where(turn > 1e-9, back, 0.0)[:, None] * (before + t)
        across = across - _along(across, t)
        across = across / np.linalg.norm(across, axis=-1, keepdims=True)
        side[:, step] = across
        before = t
    return side, cross(direction, side)


def tubes(strip: Strip, sides: int, corners: bool, closed: bool, before: dict[int, Start]) -> WeldedMesh:
    """Make tubes with flat caps around curves; closed ones have no caps. `corners` as of `_sections`.

    before: how the tubes of an earlier time start, by the first of their curves; set to that of these ones. Their sides
    turn as little as possible from then.
    """
    sections = _sections(strip, corners, closed)
    direction, first = _directions(strip.line), int(strip.curve_ids[0])
    frames = _frames(direction, before.get(first))
    before[first] = direction[:, 0], frames[0][:, 0]
    side, other = (each[:, sections.segment] for each in frames)
    turn = 2.0 * math.pi * np.arange(sides) / sides
    outward = side[:, :, None] * np.cos(turn)[:, None] + other[:, :, None] * np.sin(turn)[:, None]
    radius = (0.5 * strip.width[:, sections.sample])[:, :, None, None]
    rings = sections.place(strip.line, outward * radius)
    curves, count = rings.shape[:2]
    ring = np.arange(sides)
    after = (ring + 1) % sides
    lower = (np.arange(count if closed and corners else count - 1) * sides)[:, None]
    upper = (lower + sides) % (count * sides)
    quads = [lower + ring, lower + after, upper + after, upper + ring]
    faces = np.stack([np.stack([quads[0], quads[1], quads[2]], -1), np.stack([quads[0], quads[2], quads[3]], -1)], -2)
    positions, normals = rings.reshape(curves, -1, 3), sections.shading(outward).reshape(curves, -1, 3)
    triangles = faces.reshape(-1, 3)
    sample_of_vertex = np.repeat(sections.sample, sides)
    if not closed:
        fan = np.stack([np.zeros(sides - 2, int), np.arange(1, sides - 1), np.arange(2, sides)], axis=-1)
        caps = [fan[:, ::-1] + count * sides, fan + (count + 1) * sides]
        triangles = np.concatenate([triangles, *caps])
        positions = np.concatenate([positions, rings[:, 0], rings[:, -1]], axis=1)
        ends = [np.repeat(-sections.along[:, :1], sides, axis=1), np.repeat(sections.along[:, -1:], sides, axis=1)]
        normals = np.concatenate([normals, *ends], axis=1)
        sample_of_vertex = np.concatenate([sample_of_vertex, np.repeat(sections.sample[[0, -1]], sides)])
    return _sampled_mesh(positions, normals, triangles, strip, sample_of_vertex)


def ribbons(strip: Strip, normal: Floats, corners: bool, closed: bool) -> WeldedMesh:
    """Make ribbons along curves, facing the normals [c, m, 3]. `corners` as of `_sections`."""
    sections = _sections(strip, corners, closed)
    side = cross(sections.along, normal[:, sections.sample])
    side = side / np.maximum(np.linalg.norm(side, axis=-1, keepdims=True), 1e-30)
    facing = cross(side, sections.along)
    half = (0.5 * strip.width[:, sections.sample])[..., None] * side
    edges = sections.place(strip.line, np.stack([-half, half], axis=2))
    positions = edges.reshape(len(edges), -1, 3)
    facing = sections.shading(facing[:, :, None])[:, :, 0]
    low = 2 * np.arange(edges.shape[1] - 1)[:, None]
    triangles = (low[:, :, None] + np.array([[0, 1, 3], [0, 3, 2]])).reshape(-1, 3)
    sample_of_vertex = np.repeat(sections.sample, 2)
    return _sampled_mesh(positions, np.repeat(facing, 2, axis=1), triangles, strip, sample_of_vertex)


def _sampled_mesh(
    positions: Floats, normals: Floats, triangles: NDArray[Any], strip: Strip, sample_of_vertex: NDArray[Any]
) -> WeldedMesh:
    """Make a mesh of curves; `sample_of_vertex` [v]: the sample of the curve whose values each vertex has."""
    values = None if strip.values is None else strip.values[:, sample_of_vertex]
    return repeated(positions, normals, triangles, values, strip.curve_ids)


def repeated(
    positions: Floats, normals: Floats, triangles: NDArray[Any], values: Floats | None, elements: NDArray[Any]
) -> WeldedMesh:
    """Make a mesh of n shapes with the same triangles.

    Args:
        positions: [n, v, 3].
        normals: [n, v, 3].
        triangles: [t, 3], of one shape.
        values: vertex values [n, v, columns]; None: there are none.
        elements: [n], the curve or point that each shape is of.
    """
    shapes, vertices = positions.shape[:2]
    every = triangles + (np.arange(shapes) * vertices)[:, None, None]
    return WeldedMesh(
        positions.reshape(-1, 3).astype(np.float32),
        every.reshape(-1, 3).astype(np.int32),
        normals.reshape(-1, 3).astype(np.float32),
        None if values is None else values.reshape(-1, values.shape[-1]).astype(np.float32),
        np.repeat(elements, len(triangles)).astype(np.int32),
    )
