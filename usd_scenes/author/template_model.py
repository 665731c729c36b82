# SPDX-License-Identifier: Apache-2.0
"""`TemplateModel`: a template to author, with its colors, and shorthands for these."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from usd_scenes.author.model import Model


@dataclass(frozen=True)
class TemplateModel:
    """A template to author.

    Attributes:
        name: name of its model.
        make: builds the model of a name, in its first color.
        colors: for each color, replacements of materials.
        elementary: whether it is a primitive already, so that the appearance "primitives" uses its mesh.
    """

    name: str
    make: Callable[[str], Model]
    colors: Mapping[str, Mapping[str, str]]
    elementary: bool = False

    def colored(self, color: str) -> Model:
        """Return the model in a color, centered at its bounding box."""
        model = self.make(self.name).centered()
        swaps = self.colors[color]
        return replace(model, parts=tuple(replace(p, material=swaps.get(p.material, p.material)) for p in model.parts))


def replacing(material: str, **colors: str) -> dict[str, dict[str, str]]:
    """Return colors that differ in one material of the model: the material that takes its place in each."""
    return {color: {material: other} for color, other in colors.items()}


def shades(family: str, *colors: str) -> dict[str, dict[str, str]]:
    """Return colors that differ in one material, which is named by a family and the color; the model's own is first."""
    return replacing(family + colors[0].title(), **{color: family + color.title() for color in colors})
