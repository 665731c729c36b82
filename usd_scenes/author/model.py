# SPDX-License-Identifier: Apache-2.0
"""What furniture and templates are made of: named parts, each a mesh with a look."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from usd_scenes.author.polygon_mesh import Array, PolygonMesh, merged


@dataclass(frozen=True, eq=False)
class Part:
    """A mesh with one material. look: a name in `looks.LOOKS`. stand_ins: what primitives are fitted to instead."""

    name: str
    mesh: PolygonMesh
    look: str
    stand_ins: tuple[PolygonMesh, ...] = ()

    def changed(self, change: Callable[[PolygonMesh], PolygonMesh]) -> Part:
        return replace(self, mesh=change(self.mesh), stand_ins=tuple(change(mesh) for mesh in self.stand_ins))


@dataclass(frozen=True, eq=False)
class Model:
    """An object with an identity of its own. label: its semantic class."""

    name: str
    label: str
    parts: tuple[Part, ...]

    @property
    def bounds(self) -> Array:
        """[2, 3], m."""
        boxes = np.array([part.mesh.bounds for part in self.parts])
        return np.array([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])

    @property
    def triangles(self) -> int:
        return sum(part.mesh.triangles for part in self.parts)

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Model:
        return replace(self, parts=tuple(part.changed(lambda mesh: mesh.moved(x, y, z)) for part in self.parts))

    def turned(self, axis: str, degrees: float) -> Model:
        return replace(self, parts=tuple(part.changed(lambda mesh: mesh.turned(axis, degrees)) for part in self.parts))

    def simplified(self, **stand_ins: PolygonMesh | Iterable[PolygonMesh]) -> Model:
        """With meshes, by part, that its primitives are fitted to: where a part in one piece is like several."""
        meshes = {part: (mesh,) if isinstance(mesh, PolygonMesh) else tuple(mesh) for part, mesh in stand_ins.items()}
        return replace(self, parts=tuple(replace(part, stand_ins=meshes.get(part.name, ())) for part in self.parts))

    def centered(self) -> Model:
        """With the center of its bounding box at the origin."""
        return self.moved(*(-self.bounds.mean(axis=0)))


def thing(name: str, label: str, *parts: tuple[str, str, PolygonMesh | Iterable[PolygonMesh]]) -> Model:
    """A Model from (part name, look, mesh or meshes)."""
    built = tuple(
        Part(part, mesh if isinstance(mesh, PolygonMesh) else merged(mesh), look) for part, look, mesh in parts
    )
    return Model(name, label, built)
