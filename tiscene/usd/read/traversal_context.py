# SPDX-License-Identifier: Apache-2.0
"""TraversalContext: what a prim inherits from its ancestors."""

from __future__ import annotations

from dataclasses import dataclass, field

from pxr import Gf, UsdGeom

from tiscene.usd.core.prims import DRAWN_PURPOSES
from tiscene.usd.core.time_samples import NOT_ANIMATED, AnimatedAncestors
from tiscene.usd.read.object_builder import StageObject


@dataclass(frozen=True)
class TraversalContext:
    """What a prim inherits from its ancestors. The default is that of prims at a stage's root.

    Attributes:
        world: world transform, in stage units.
        visible: visibility at the time read; True where it is animated (`animated`).
        purpose: UsdGeomImageable's purpose.
        renders: whether renderVisibility shows prims of purpose "render".
        label: semantic label, "" for none.
        label_is_own: whether the label was authored within the object that the prim is part of.
        owner: the object that the prim is part of; None: not in an object.
        animated: animated ancestors.
    """

    world: Gf.Matrix4d = field(default_factory=lambda: Gf.Matrix4d(1.0))
    visible: bool = True
    purpose: str = UsdGeom.Tokens.default_
    renders: bool = True
    label: str = ""
    label_is_own: bool = False
    owner: StageObject | None = None
    animated: AnimatedAncestors = NOT_ANIMATED

    @property
    def is_drawn(self) -> bool:
        """Whether gprims with this context are drawn. Colliders collide even if they are not."""
        is_shown = self.visible and (self.renders or self.purpose != UsdGeom.Tokens.render)
        return is_shown and self.purpose in DRAWN_PURPOSES
