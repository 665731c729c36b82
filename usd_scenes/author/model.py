# SPDX-License-Identifier: Apache-2.0
"""Models: furniture and templates as named parts, each a mesh with one material."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from usd_scenes.author.polygon_mesh import Array, PolygonMesh, merged


@dataclass(frozen=True, eq=False)
class Part:
    """A mesh with one material.

    Attributes:
        name: prim name.
        mesh: the geometry.
        material: a name in `material_presets.PRESETS`.
        proxies: meshes that primitives are fitted to in place of `mesh`; empty for `mesh` itself.
    """

    name: str
    mesh: PolygonMesh
    material: str
    proxies: tuple[PolygonMesh, ...] = ()

    def mapped(self, function: Callable[[PolygonMesh], PolygonMesh]) -> Part:
        """Return the part with `function` applied to its mesh and its proxies."""
        return replace(self, mesh=function(self.mesh), proxies=tuple(function(mesh) for mesh in self.proxies))


@dataclass(frozen=True, eq=False)
class Model:
    """An object of named parts.

    Attributes:
        name: prim name.
        label: semantic class.
        parts: the parts.
    """

    name: str
    label: str
    parts: tuple[Part, ...]

    @property
    def bounds(self) -> Array:
        """Lower and upper corner of the bounding box, [2, 3], m."""
        boxes = np.array([part.mesh.bounds for part in self.parts])
        return np.array([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])

    @property
    def triangles(self) -> int:
        """Number of triangles of all parts."""
        return sum(part.mesh.triangles for part in self.parts)

    def translated(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Model:
        """Return the model moved by (x, y, z), m."""
        return replace(self, parts=tuple(part.mapped(lambda mesh: mesh.translated(x, y, z)) for part in self.parts))

    def rotated(self, axis: str, degrees: float) -> Model:
        """Return the model rotated about "x", "y" or "z" through the origin."""
        return replace(self, parts=tuple(part.mapped(lambda mesh: mesh.rotated(axis, degrees)) for part in self.parts))

    def with_proxies(self, **proxies: PolygonMesh | Iterable[PolygonMesh]) -> Model:
        """Return the model with proxies, by part name: for parts of one piece that resemble several primitives."""
        meshes = {part: (mesh,) if isinstance(mesh, PolygonMesh) else tuple(mesh) for part, mesh in proxies.items()}
        return replace(self, parts=tuple(replace(part, proxies=meshes.get(part.name, ())) for part in self.parts))

    def centered(self) -> Model:
        """Return the model with the center of its bounding box at the origin."""
        return self.translated(*(-self.bounds.mean(axis=0)))


def make_model(name: str, label: str, *parts: tuple[str, str, PolygonMesh | Iterable[PolygonMesh]]) -> Model:
    """Build a model from (part name, material, mesh or meshes) tuples."""
    built = tuple(
        Part(part, mesh if isinstance(mesh, PolygonMesh) else merged(mesh), material) for part, material, mesh in parts
    )
    return Model(name, label, built)
