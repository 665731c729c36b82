# SPDX-License-Identifier: Apache-2.0
"""MaterialX node networks (shaders with ids such as ND_multiply_color3) as signals.

Nodes that only depend on texture coordinates, image files and constants are computed (`materialx_operations`,
`materialx_noise`). A node that is not supported, such as noise of the place in space, is replaced by its mean, which
is reported. (The texture baker of the MaterialX package needs OpenGL, so that it cannot run everywhere.)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from pxr import Sdf, Usd

from tiscene.usd.core.color_space import attribute_colors
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.shader_network import ShaderConnection, Source, connections_of
from tiscene.usd.materials.materialx_baker import Baker
from tiscene.usd.materials.materialx_images import PLACE, ImageNode
from tiscene.usd.materials.materialx_nodes import (
    COMPONENTS,
    IMAGES,
    NOISES,
    THROUGH,
    category_of,
    output_width,
)
from tiscene.usd.materials.materialx_noise import NOISES_2D, NOISES_3D, noise_signal
from tiscene.usd.materials.materialx_operations import OPERATIONS
from tiscene.usd.materials.materialx_signal import (
    Coordinates,
    Floats,
    Signal,
    affine_operation,
    number,
    placement,
    rotation,
    shift,
    widened,
)
from tiscene.usd.materials.materialx_units import is_in_radians
from tiscene.usd.materials.texture import TextureTable

_MEAN_HALF = tuple(each for each in NOISES if each.startswith(("cell", "worley", "unified")))
_MAX_DEPTH = 64
_MAX_BRANCHES = 10  # of a switch


@dataclass(eq=False)
class MaterialXNetwork:
    """Evaluates the inputs of MaterialX nodes.

    Attributes:
        path: of the surface shader.
        textures: table for image files and computed images.
        time: when to evaluate attributes.
        report: collects nodes that are not supported.
        vertex_color: returns whether the gprim's primvar of a name varies, and its constant value otherwise.
        baker: computes per texel.
    """

    path: Sdf.Path
    textures: TextureTable
    time: Usd.TimeCode
    report: StageReport
    vertex_color: Callable[[str, int], Signal | None]

    def __post_init__(self) -> None:
        self._known: dict[tuple[Sdf.Path, str], Signal] = {}
        self._open: list[tuple[Sdf.Path, str]] = []
        # A method would refer to the network, which would then keep its images until they are collected as garbage.
        self.baker = Baker(self.textures, partial(_report_whitened, self.path, self._open, self.report))

    def value(self, connection: ShaderConnection | None, default: Any) -> Signal:
        """Return an input's value.

        Args:
            connection: the input; None: not authored.
            default: number or numbers; None: texture coordinates.
        """
        if connection is not None and connection.source is not None:
            return self.output(connection.source)
        value = None if connection is None else connection.value
        if value is not None and not isinstance(value, str | Sdf.AssetPath):
            numbers = [float(each) for each in value] if hasattr(value, "__len__") else [float(value)]
            if numbers and all(math.isfinite(each) for each in numbers):
                if len(numbers) > 2 and connection is not None:
                    numbers = attribute_colors(connection.attribute, np.array(numbers)).tolist()
                if len(numbers) == 1 and connection is not None and is_in_radians(connection.attribute):
                    numbers = [math.degrees(numbers[0])]
                return number(*numbers)
        if default is None:
            return Signal(uv=Coordinates())
        return number(*default) if isinstance(default, tuple) else number(default)

    def output(self, source: Source) -> Signal:
        """Return an output of a node."""
        key = (source.shader.GetPath(), source.output)
        if key not in self._known:
            if key in self._open or len(self._open) > _MAX_DEPTH:
                self.report.omission(key[0], "a MaterialX node that is connected to itself counts as 0")
                return number(0.0)
            self._open.append(key)
            self._known[key] = self._evaluate(source)
            self._open.pop()
        return self._known[key]

    def numbers(self, inputs: dict[str, ShaderConnection], name: str, default: tuple[float, ...]) -> Floats:
        """Return an input that must be constant; a texture is reported and replaced by its mean."""
        signal = self.value(inputs.get(name), default)
        if signal.constant is None:
            text = f"{name} cannot come from a texture; its mean is used"
            self.report.omission(self._open[-1][0] if self._open else self.path, text)
        return self.baker.mean(signal.of_width(len(default)))

    def _evaluate(self, source: Source) -> Signal:
        inputs = connections_of(source.shader, self.time)
        category = category_of(source.id)
        result = self._special(category, source, inputs)
        if result is None and category in OPERATIONS:
            result = self._operation(category, inputs)
        if result is None:
            name = source.id or str(source.shader.GetPath().name)
            self.report.omission(source.shader.GetPath(), f"MaterialX node {name!r} is not supported; it counts as 0.5")
            result = number(0.5)
        width = output_width(source, category)
        if not width or (width == 3 and result.uv is not None and "vector3" in source.id):  # a point (u, v, 0)
            return result
        return result.of_width(width)

    def _operation(self, category: str, inputs: dict[str, ShaderConnection]) -> Signal:
        names, function = OPERATIONS[category]
        operands = [self.value(inputs.get(name), default) for name, default in names]
        is_point = [default is None for _, default in names]
        return affine_operation(category, operands) or self.baker.apply(function, *widened(operands, is_point))

    def _special(self, category: str, source: Source, inputs: dict[str, ShaderConnection]) -> Signal | None:
        """Return the output of a node that is not a function of values alone; None for other nodes."""
        if category in IMAGES:
            node = ImageNode(category, source, inputs, self.value, self.numbers, self.baker, self.textures, self.report)
            return node.signal()
        if category in ("texcoord", "geompropvalue", "geompropvalueuniform", "UsdPrimvarReader", "geomcolor"):
            return self._primvar(category, source, inputs)
        if category in THROUGH:
            found = self.value(inputs.get("value" if category == "constant" else "in"), 0.0)
            width = output_width(source, category)
            is_point = width == 3 and found.uv is not None
            return found.extended(width, self.baker.apply) if category == "convert" and not is_point else found
        if category in ("heighttonormal", "bump"):
            height = self.value(inputs.get("in" if category == "heighttonormal" else "height"), 0.0)
            return self.baker.normals(height, float(self.numbers(inputs, "scale", (1.0,))[0]))
        if category in NOISES:
            return self._noise(category, source, inputs)
        if category in ("place2d", "rotate2d", "rotate3d", "UsdTransform2d"):
            return self._placed(category, inputs)
        if category in ("extract", "swizzle", *(f"separate{count}" for count in (2, 3, 4))):
            components = self._components(category, source, inputs)
            return self.value(inputs.get("in"), 0.0).select(components)
        if category.startswith("combine"):
            parts = [self.value(inputs.get(f"in{row + 1}"), 0.0) for row in range(int(category[-1]))]
            return self.baker.apply(lambda *values: _joined(values), *parts)
        if category == "switch":
            which = self.value(inputs.get("which"), 0.0)
            if which.constant is not None:
                return self.value(inputs.get(f"in{int(which.constant[0]) + 1}"), 0.0)
            operands = [self.value(inputs.get(f"in{row + 1}"), 0.0) for row in range(_MAX_BRANCHES)]
            return self.baker.apply(_switched, which, *widened(operands, [False] * _MAX_BRANCHES))
        return None

    def _components(self, category: str, source: Source, inputs: dict[str, ShaderConnection]) -> list[int]:
        if category == "extract":
            return [int(self.numbers(inputs, "index", (0.0,))[0])]
        if category == "swizzle":
            channels = inputs.get("channels")
            return [COMPONENTS.get(each, 0) for each in str(channels.value if channels else "")] or [0]
        return [COMPONENTS.get(source.output[-1:], 0)]

    def _noise(self, category: str, source: Source, inputs: dict[str, ShaderConnection]) -> Signal:
        """Return a noise of texture coordinates, computed per texel, else the mean, which is reported."""
        if category in NOISES_3D:  # without texture coordinates, of the place in space
            at = self.value(inputs.get("position"), 0.0)
        else:
            at = self.value(inputs.get("texcoord"), None)
        if at.constant is None or category in NOISES_2D:
            width = 1 if category.startswith("cell") else output_width(source, category)
            found = noise_signal(
                category, at, width, lambda *named: self.value(inputs.get(named[0]), named[1]), self.baker
            )
            if found is not None:
                return found
        text = f"MaterialX node {category!r} is not computed; its mean is used"
        self.report.omission(source.shader.GetPath(), text)
        return number(0.5) if category in _MEAN_HALF else self.value(inputs.get("pivot"), 0.0)

    def _primvar(self, category: str, source: Source, inputs: dict[str, ShaderConnection]) -> Signal | None:
        """Return texture coordinates, or another primvar: a constant or the vertices' colors."""
        if category == "texcoord":
            index = int(self.numbers(inputs, "index", (0.0,))[0])
            return Signal(uv=Coordinates(primvar="" if index == 0 else f"st{index}"))
        named = inputs.get("varname" if category == "UsdPrimvarReader" else "geomprop")
        name = "displayColor" if category == "geomcolor" else str(named.value if named and named.value else "")
        if "vector2" in source.id or "float2" in source.id:
            return Signal(uv=Coordinates(primvar=name))
        width = output_width(source, category) or 3
        found = self.vertex_color(name, width)
        if found is None:
            default = inputs.get("fallback" if category == "UsdPrimvarReader" else "default")
            return self.value(default, 1.0 if category == "geomcolor" else 0.0)
        return found

    def _placed(self, category: str, inputs: dict[str, ShaderConnection]) -> Signal | None:
        """Return texture coordinates after place2d, rotate2d (clockwise, degrees), rotate3d about z or UsdTransform2d.

        None: a rotation of something else, or out of the plane of texture coordinates, which is computed per texel.
        """
        at = self.value(inputs.get("texcoord" if category == "place2d" else "in"), None)

        numbers = partial(self.numbers, inputs)
        if category == "rotate3d":
            if at.uv is None:
                return None
            turn, axis = numbers("amount", (0.0,))[0], numbers("axis", (0.0, 1.0, 0.0))
            if turn == 0.0:
                return at
            if axis[2] == 0.0 or axis[:2].any():
                return None
            return Signal(uv=at.uv.mapped(rotation(-math.copysign(turn, turn * axis[2]))), third=at.third)
        if category == "rotate2d":
            return self.baker.mapped(at, rotation(-numbers("amount", (0.0,))[0]))
        if category == "UsdTransform2d":
            move, scale = numbers("translation", (0.0, 0.0)), numbers("scale", (1.0, 1.0))
            matrix = shift(*move) @ rotation(numbers("rotation", (0.0,))[0]) @ np.diag([*scale, 1.0])
            return self.baker.mapped(at, matrix)
        pivot, scale, turn, move = (numbers(name, default) for name, default in PLACE)
        translate_first = numbers("operationorder", (0.0,))[0] == 1.0
        return self.baker.mapped(at, placement(pivot, scale, turn, move, translate_first))


def _report_whitened(surface: Sdf.Path, open_nodes: Sequence[tuple[Sdf.Path, str]], report: StageReport) -> None:
    path = open_nodes[-1][0] if open_nodes else surface
    text = "colors of vertices are only scaled, shifted and multiplied by one image; they count as white here"
    report.omission(path, text)


def _joined(values: Any) -> Any:
    shape = np.broadcast_shapes(*(each.shape[:-1] for each in values))
    return np.concatenate([np.broadcast_to(each, (*shape, each.shape[-1])) for each in values], axis=-1)


def _switched(which: Any, *branches: Any) -> Any:
    """Return the branch of each number; 0 beyond them."""
    width = max(each.shape[-1] for each in branches)
    result = np.zeros((*which.shape[:-1], width))
    for row, branch in enumerate(branches):
        result = np.where(np.floor(which) == row, branch, result)
    return result
