# SPDX-License-Identifier: Apache-2.0
"""The inputs of a MaterialX surface shader as numbers, signals and material inputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf

from tiscene.scene.description import ColorInput, FloatInput, TextureLookup
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.shader_network import ShaderConnection
from tiscene.usd.materials.materialx_models import Named
from tiscene.usd.materials.materialx_network import MaterialXNetwork
from tiscene.usd.materials.materialx_signal import Signal


@dataclass(frozen=True, eq=False)
class SurfaceInputs:
    """Evaluates the inputs of one surface shader. An input is given as (name, default), see `materialx_models.Named`.

    Attributes:
        path: of the shader.
        authored: its authored inputs.
        network: evaluates them.
        report: collects what is not applied.
        uv_set: returns which uv set of the vertices holds a primvar.
        computed: values of inputs that come before the authored ones.
    """

    path: Sdf.Path
    authored: dict[str, ShaderConnection]
    network: MaterialXNetwork
    report: StageReport
    uv_set: Callable[[str], Literal[0, 1]]
    computed: Mapping[str, Signal] = field(default_factory=dict)

    def gives(self, name: str) -> bool:
        """Return whether an input is authored or computed."""
        return name in self.computed or name in self.authored

    def signal(self, named: Named) -> Signal:
        """Return an input's value."""
        return self.computed.get(named[0]) or self.network.value(self.authored.get(named[0]), named[1])

    def constant(self, named: Named) -> NDArray[np.float64]:
        """Return an input that must be constant; a texture is reported and replaced by its mean."""
        signal = self.signal(named)
        if signal.constant is None:
            self.report.omission(self.path, f"{named[0]} cannot come from a texture; its mean is used")
        return self.network.baker.mean(signal)

    def mean(self, named: Named) -> float:
        """Return an input that must be a number, see `constant`."""
        return float(self.constant(named).mean())

    def product(self, *named: Named) -> Signal:
        """Return the product of two inputs."""
        return self.network.baker.product(*map(self.signal, named))

    def number(self, name: str, default: float) -> float:
        """Return an input that must be a number and may be missing."""
        return self.mean((name, default)) if name in self.authored else default

    def color_input(self, signal: Signal, name: str) -> ColorInput:
        """Return a signal as a color or its texture. name: for messages."""
        found = self.network.baker.lookup(signal, 3, name, self.uv_set)
        if isinstance(found, TextureLookup):
            return found
        r, g, b = found.tolist()
        return (r, g, b)

    def float_input(self, signal: Signal, name: str) -> FloatInput:
        """Return a signal as a number or its texture. name: for messages."""
        found = self.network.baker.lookup(signal, 1, name, self.uv_set)
        return found if isinstance(found, TextureLookup) else float(found[0])
