# SPDX-License-Identifier: Apache-2.0
"""`TemplateModel`: a template to author, with its colors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from usd_scenes.author.model import Model


@dataclass(frozen=True)
class TemplateModel:
    """A template to author.

    Attributes:
        make: builds the model in its first color.
        colors: for each color, replacements of materials.
        elementary: whether it is a primitive already, so that the appearance "primitives" uses its mesh.
    """

    make: Callable[[], Model]
    colors: Mapping[str, Mapping[str, str]]
    elementary: bool = False

    def colored(self, color: str) -> Model:
        """Return the model in a color, centered at its bounding box."""
        model = self.make().centered()
        swaps = self.colors[color]
        return replace(model, parts=tuple(replace(p, material=swaps.get(p.material, p.material)) for p in model.parts))
