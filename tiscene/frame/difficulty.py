# SPDX-License-Identifier: Apache-2.0
"""Difficulty: measures of how hard a frame is for vision, from its labels.

Size, visibility, contrast and novelty are means over the targets that are visible: the objects of the scenario, or, of
a frame at which none of them exists, all objects. Measures whose buffer a frame does not have are None.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tiscene.frame.object_table import ObjectTable
from tiscene.scene.color import LUMINANCE, decode_srgb

LEAST_MOTION = 0.1  # px per frame: a pixel that moves less counts as still
BAND = 3  # px: width of the background around an object that its contrast is measured against
NEVER_SHOWN = 180.0  # degrees


class ViewNovelty(Protocol):
    """The novelty of the views of a frame's objects, computed on demand (`tiscene.world.view_history`)."""

    def angles(self) -> Mapping[int, float]:
        """Return the angle to the nearest view shown before of each object of the scenario, by id, degrees."""
        ...


@dataclass(frozen=True)
class Difficulty:
    """Measures of one frame.

    Attributes:
        instances: number of visible objects, those of the stage included.
        categories: number of their categories.
        visibility: fraction of a target that is visible (`fraction_visible`), 0..1. Out of the image counts as hidden.
        size: fraction of the image that a target's visible pixels fill, 0..1.
        motion: length of the flow over the pixels that move, px per frame. Needs a buffer of flow.
        moving: fraction of the image's pixels that move by 0.1 px per frame or more. Needs a buffer of flow.
        contrast: Michelson contrast of luminance between a target and the 3 px around it, 0..1. Needs `rgb`.
        novelty: angle, degrees, between the direction from which a target is seen and the nearest one from which it was
            in view from one to 64 seconds before; 180 where it was not. None without objects of the scenario.
    """

    instances: int
    categories: int
    visibility: float | None
    size: float | None
    motion: float | None
    moving: float | None
    contrast: float | None
    novelty: float | None

    def to_json(self) -> dict[str, float | None]:
        """Return the measures by name."""
        return {each.name: getattr(self, each.name) for each in fields(self)}


MEASURES = tuple(each.name for each in fields(Difficulty))


def difficulty_of(
    buffers: Mapping[str, NDArray[Any]], objects: ObjectTable, pixels: int, novelty: ViewNovelty | None
) -> Difficulty:
    """Measure a frame.

    Args:
        buffers: of the frame, by name.
        objects: of the frame.
        pixels: number of its pixels.
        novelty: of the views of its objects; None: unknown.
    """
    visible = [row for row in objects if row.visible_pixels]
    has_scenario = any(row.template for row in objects)
    targets = [row for row in visible if row.template or not has_scenario]
    flow = buffers.get("forward_flow", buffers.get("backward_flow"))
    motion = moving = None
    if flow is not None:
        length = np.linalg.norm(flow, axis=2)
        moves = length >= LEAST_MOTION
        moving = float(moves.mean())
        motion = float(length[moves].mean()) if moves.any() else 0.0
    contrast = None
    if "rgb" in buffers and "instance" in buffers:
        luminance = decode_srgb(buffers["rgb"] / 255.0) @ LUMINANCE
        contrast = _mean(_contrast(luminance, buffers["instance"] == row.id) for row in targets)
    angles = novelty.angles() if novelty is not None and has_scenario else {}
    return Difficulty(
        instances=len(visible),
        categories=len({row.category for row in visible if row.category}),
        visibility=_mean(objects.fractions_visible(targets)),
        size=_mean(row.visible_pixels / pixels for row in targets),
        motion=motion,
        moving=moving,
        contrast=contrast,
        novelty=_mean(angles.get(row.id) for row in targets),
    )


def summary(measured: Iterable[Difficulty]) -> dict[str, dict[str, float | None]]:
    """Return mean, min and max over frames by measure: {"motion": {"mean": 1.5, ...}, ...}; None without values."""
    rows = list(measured)
    result: dict[str, dict[str, float | None]] = {}
    for name in MEASURES:
        values = [value for row in rows if (value := getattr(row, name)) is not None]
        result[name] = {
            "mean": float(np.mean(values)) if values else None,
            "min": float(min(values)) if values else None,
            "max": float(max(values)) if values else None,
        }
    return result


def _contrast(luminance: NDArray[np.float64], mask: NDArray[np.bool_]) -> float | None:
    """Return the contrast between a mask's pixels and those around it; None if it has none around."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return None
    y0, x0 = max(rows[0] - BAND, 0), max(columns[0] - BAND, 0)
    window = slice(y0, rows[-1] + BAND + 1), slice(x0, columns[-1] + BAND + 1)
    inside, around = mask[window], mask[window]
    for axis in (0, 1):
        padded = np.pad(around, [(BAND, BAND) if each == axis else (0, 0) for each in (0, 1)])
        count = around.shape[axis]
        around = np.any([padded.take(range(by, by + count), axis=axis) for by in range(2 * BAND + 1)], axis=0)
    band = around & ~inside
    if not band.any():
        return None
    own, other = float(luminance[window][inside].mean()), float(luminance[window][band].mean())
    return abs(own - other) / (own + other) if own + other > 0.0 else 0.0


def _mean(values: Iterable[Any]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None
