# SPDX-License-Identifier: Apache-2.0
"""Templates that this process has read last, so that scenario after scenario reads and filters nothing again."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple

from tiscene.scene.description import SceneDescription, Template
from tiscene.usd.core.layers import layer_state
from tiscene.usd.core.report import StageReport
from tiscene.usd.read.template import template_and_report

MAX_BYTES = 1 << 28  # 256 MB; the shipped templates have 170 MB
_MIPMAPS = 4.0 / 3.0  # memory of an image with its coarser copies, over that of the image


class _Kept(NamedTuple):
    """A template, what was left out of it, and the state of its files before it was read."""

    template: Template
    report: StageReport
    state: Hashable
    nbytes: int


_kept: dict[tuple[Any, ...], _Kept] = {}  # by file and options; the least recently used first


def kept_template(
    path: str | Path,
    *,
    up_axis: Literal["Y", "Z"] | None = None,
    variants: Mapping[str, str] | None = None,
    taxonomy: str | None = None,
) -> Template:
    """Return `read_template` of the same arguments, and read only what has changed or was not used for long.

    The template is shared: its arrays must not be written to.

    Raises:
        MissingFile, StageError, UnknownName: as `read_template`.
    """
    key = str(Path(path).resolve()), up_axis, tuple(sorted((variants or {}).items())), taxonomy
    kept = _kept.pop(key, None)
    state = layer_state(path) if Path(path).is_file() else None  # before it is read: files may change meanwhile
    if kept is None or state is None or kept.state != state:
        template, report = template_and_report(path, up_axis, variants, taxonomy)
        kept = _Kept(template, report, state, _bytes_of(template.description))
    _kept[key] = kept
    total = sum(each.nbytes for each in _kept.values())
    while total > MAX_BYTES:
        total -= _kept.pop(next(iter(_kept))).nbytes
    kept.report.warn()
    return kept.template


def _bytes_of(description: SceneDescription) -> int:
    """Return the memory of a template's meshes and images."""
    arrays = [array for mesh in description.meshes for array in vars(mesh).values()]
    meshes = sum(getattr(array, "nbytes", 0) for array in arrays)
    return meshes + math.ceil(_MIPMAPS * sum(texture.pixels.nbytes for texture in description.textures))
