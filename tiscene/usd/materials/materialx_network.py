# SPDX-License-Identifier: Apache-2.0
"""MaterialX node networks (shaders with ids such as ND_multiply_color3) as signals.

Nodes that only depend on texture coordinates, image files and constants are computed (`materialx_operations`,
`materialx_noise`). A node that is not supported, such as noise of the place in space, is replaced by its mean, which
is reported. (The texture baker of the MaterialX package needs OpenGL, so that it cannot run everywhere.)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from pxr import Sdf, Usd

from tiscene.scene.description import VERTEX_COLORS
from tiscene.usd.core.color_space import LINEAR, SRGB, attribute_colors, color_space
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.shader_network import ShaderConnection, Source, connections_of
from tiscene.usd.materials.materialx_baker import Baker
from tiscene.usd.materials.materialx_noise import NOISES_2D, NOISES_3D, noise_signal
from tiscene.usd.materials.materialx_operations import OPERATIONS
from tiscene.usd.materials.materialx_signal import (
    Coordinates,
    Signal,
    affine_operation,
    number,
    placement,
    rotation,
    shift,
    widened,
)
from tiscene.usd.materials.texture import TextureTable

_COMPONENTS = {"x": 0, "y": 1, "z": 2, "w": 3, "r": 0, "g": 1, "b": 2, "a": 3}
_WIDTHS = {"float": 1, "integer": 1, "boolean": 1, "color3": 3, "vector3": 3, "color4": 4, "vector4": 4, "vector2": 2}
_WRAPS = {"periodic": "repeat", "clamp": "clamp", "mirror": "mirror", "constant": "black"}
_THROUGH = ("convert", "dot", "blur", "constant", "normalmap")  # nodes that pass one input on
_NOISES = (*NOISES_2D, *NOISES_3D)
_MEAN_HALF = tuple(each for each in _NOISES if each.startswith(("cell", "worley", "unified")))
_SIMPLIFIED = {  # nodes that are drawn as another one
    "hextiledimage": "drawn as a tiledimage",
    "triplanarprojection": "drawn as its filez, by the mesh's texture coordinates",
}
_IMAGES = ("image", "tiledimage", "gltf_image", "gltf_colorimage", "gltf_normalmap", "UsdUVTexture", *_SIMPLIFIED)
_FOUR_CHANNELS = ("UsdUVTexture", "gltf_colorimage")  # nodes of several outputs
_FACTORS = {"UsdUVTexture": ("scale",), "gltf_image": ("factor",), "gltf_colorimage": ("color", "geomcolor")}
_NUMBERS = ("extract", "dotproduct", "magnitude", "distance")  # nodes of one component, whatever the type in their id
_SPECIAL = (
    *(*_THROUGH, *_NOISES, *_IMAGES, "texcoord", "geompropvalue", "geompropvalueuniform", "geomcolor", "place2d"),
    *("rotate2d", "extract", "swizzle", "separate2", "separate3", "separate4", "combine2", "combine3", "combine4"),
    *("switch", "UsdPrimvarReader", "UsdTransform2d", "rotate3d", "heighttonormal", "bump"),
)
_CATEGORIES = sorted({*OPERATIONS, *_SPECIAL}, key=len, reverse=True)
_PLACE = (("pivot", (0.0, 0.0)), ("scale", (1.0, 1.0)), ("rotate", (0.0,)), ("offset", (0.0, 0.0)))
_MAX_DEPTH = 64


def category_of(shader: str) -> str:
    """Return the category of a node from its id: "multiply" of "ND_multiply_color3FA"; "" for none that is known."""
    name = shader.removeprefix("ND_")
    return next((each for each in _CATEGORIES if name == each or name.startswith(f"{each}_")), "")


def is_geometric(shader: str) -> bool:
    """Return whether a node, by its id, gives the mesh's own normal or tangent."""
    return shader.startswith(("ND_normal_", "ND_tangent_"))


class MaterialXNetwork:
    """Evaluates the inputs of MaterialX nodes.

    Args:
        path: of the surface shader.
        textures: table for image files and computed images.
        time: when to evaluate attributes.
        report: collects nodes that are not supported.
        vertex_color: returns whether the gprim's primvar of a name varies, and its constant value otherwise.
    """

    def __init__(
        self,
        path: Sdf.Path,
        textures: TextureTable,
        time: Usd.TimeCode,
        report: StageReport,
        vertex_color: Callable[[str, int], Signal | None],
    ) -> None:
        self._textures = textures
        self._time = time
        self._report = report
        self._vertex_color = vertex_color
        self._known: dict[tuple[Sdf.Path, str], Signal] = {}
        self._open: list[tuple[Sdf.Path, str]] = []
        # A method would refer to the network, which would then keep its images until they are collected as garbage.
        self.baker = Baker(textures, partial(_report_whitened, path, self._open, report))

    def value(self, connection: ShaderConnection | None, default: Any) -> Signal | None:
        """Return an input's value.

        Args:
            connection: the input; None: not authored.
            default: number or numbers; None: texture coordinates; "": None is returned for an input that is not
                authored.
        """
        if connection is not None and connection.source is not None:
            return self.output(connection.source)
        value = None if connection is None else connection.value
        if value is not None and not isinstance(value, str | Sdf.AssetPath):
            numbers = [float(each) for each in value] if hasattr(value, "__len__") else [float(value)]
            if numbers and all(math.isfinite(each) for each in numbers):
                if len(numbers) > 2 and connection is not None:
                    numbers = attribute_colors(connection.attribute, np.array(numbers)).tolist()
                return number(*numbers)
        if default == "":
            return None
        if default is None:
            return Signal(uv=Coordinates())
        return number(*default) if isinstance(default, tuple) else number(default)

    def output(self, source: Source) -> Signal:
        """Return an output of a node."""
        key = (source.shader.GetPath(), source.output)
        if key not in self._known:
            if key in self._open or len(self._open) > _MAX_DEPTH:
                self._report.omission(key[0], "a MaterialX node that is connected to itself counts as 0")
                return number(0.0)
            self._open.append(key)
            self._known[key] = self._evaluate(source)
            self._open.pop()
        return self._known[key]

    def _evaluate(self, source: Source) -> Signal:
        inputs = connections_of(source.shader, self._time)
        category = category_of(source.id)
        result = self._special(category, source, inputs)
        if result is None and category in OPERATIONS:
            result = self._operation(category, inputs)
        if result is None:
            name = source.id or str(source.shader.GetPath().name)
            self._report.omission(
                source.shader.GetPath(), f"MaterialX node {name!r} is not supported; it counts as 0.5"
            )
            result = number(0.5)
        width = _output_width(source, category)
        if not width or (width == 3 and result.uv is not None and "vector3" in source.id):  # a point (u, v, 0)
            return result
        return result.of_width(width)

    def _operation(self, category: str, inputs: dict[str, ShaderConnection]) -> Signal:
        names, function = OPERATIONS[category]
        operands = [self._required(inputs.get(name), default) for name, default in names]
        is_point = [default is None for _, default in names]
        return affine_operation(category, operands) or self.baker.apply(function, *widened(operands, is_point))

    def _required(self, connection: ShaderConnection | None, default: Any) -> Signal:
        found = self.value(connection, default)
        assert found is not None
        return found

    def _special(self, category: str, source: Source, inputs: dict[str, ShaderConnection]) -> Signal | None:
        """Return the output of a node that is not a function of values alone; None for other nodes."""
        if category in _IMAGES:
            return self._image(category, source, inputs)
        if category in ("texcoord", "geompropvalue", "geompropvalueuniform", "UsdPrimvarReader", "geomcolor"):
            return self._primvar(category, source, inputs)
        if category in _THROUGH:
            found = self._required(inputs.get("value" if category == "constant" else "in"), 0.0)
            width = _output_width(source, category)
            if category != "convert" or found.width != 2 or width < 3 or (width == 3 and found.uv is not None):
                return found
            return self.baker.apply(_extended, found)
        if category in ("heighttonormal", "bump"):
            height = self._required(inputs.get("in" if category == "heighttonormal" else "height"), 0.0)
            return self.baker.normals(height, float(self.baker.mean(self._required(inputs.get("scale"), 1.0))[0]))
        if category in _NOISES:
            return self._noise(category, source, inputs)
        if category in ("place2d", "rotate2d", "rotate3d", "UsdTransform2d"):
            return self._placed(category, inputs)
        if category in ("extract", "swizzle", *(f"separate{count}" for count in (2, 3, 4))):
            components = self._components(category, source, inputs)
            return self._required(inputs.get("in"), 0.0).select(components)
        if category.startswith("combine"):
            parts = [self._required(inputs.get(f"in{row + 1}"), 0.0) for row in range(int(category[-1]))]
            return self.baker.apply(lambda *values: _joined(values), *parts)
        if category == "switch":
            which = self._required(inputs.get("which"), 0.0)
            row = int(self.baker.mean(which)[0])
            return self._required(inputs.get(f"in{row + 1}"), 0.0)
        return None

    def _components(self, category: str, source: Source, inputs: dict[str, ShaderConnection]) -> list[int]:
        if category == "extract":
            return [int(self.baker.mean(self._required(inputs.get("index"), 0.0))[0])]
        if category == "swizzle":
            channels = inputs.get("channels")
            return [_COMPONENTS.get(each, 0) for each in str(channels.value if channels else "")] or [0]
        return [_COMPONENTS.get(source.output[-1:], 0)]

    def _noise(self, category: str, source: Source, inputs: dict[str, ShaderConnection]) -> Signal:
        """Return a noise of texture coordinates, computed per texel, else the mean, which is reported."""
        at = (
            self.value(inputs.get("position"), "")
            if category in NOISES_3D
            else self._required(inputs.get("texcoord"), None)
        )
        if at is not None and (at.constant is None or category in NOISES_2D):
            width = 1 if category.startswith("cell") else _output_width(source, category)
            found = noise_signal(
                category, at, width, lambda name, start: self._required(inputs.get(name), start), self.baker
            )
            if found is not None:
                return found
        text = f"MaterialX node {category!r} is not computed; its mean is used"
        self._report.omission(source.shader.GetPath(), text)
        return number(0.5) if category in _MEAN_HALF else self._required(inputs.get("pivot"), 0.0)

    def _primvar(self, category: str, source: Source, inputs: dict[str, ShaderConnection]) -> Signal | None:
        """Return texture coordinates, or another primvar: a constant or the vertices' colors."""
        if category == "texcoord":
            index = int(self.baker.mean(self._required(inputs.get("index"), 0.0))[0])
            return Signal(uv=Coordinates(primvar="" if index == 0 else f"st{index}"))
        named = inputs.get("varname" if category == "UsdPrimvarReader" else "geomprop")
        name = "displayColor" if category == "geomcolor" else str(named.value if named and named.value else "")
        if "vector2" in source.id or "float2" in source.id:
            return Signal(uv=Coordinates(primvar=name))
        width = _output_width(source, category) or 3
        found = self._vertex_color(name, width)
        if found is None:
            default = inputs.get("fallback" if category == "UsdPrimvarReader" else "default")
            return self._required(default, 1.0 if category == "geomcolor" else 0.0)
        return found

    def _placed(self, category: str, inputs: dict[str, ShaderConnection]) -> Signal | None:
        """Return texture coordinates after place2d, rotate2d (clockwise, degrees), rotate3d about z or UsdTransform2d.

        None: a rotation of something else, or out of the plane of texture coordinates, which is computed per texel.
        """
        at = self._required(inputs.get("texcoord" if category == "place2d" else "in"), None)

        def numbers(name: str, default: tuple[float, ...]) -> Any:
            return self.baker.mean(self._required(inputs.get(name), default).of_width(len(default)))

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
        pivot, scale, turn, move = (numbers(name, default) for name, default in _PLACE)
        translate_first = numbers("operationorder", (0.0,))[0] == 1.0
        return self.baker.mapped(at, placement(pivot, scale, turn, move, translate_first))

    def _image(self, category: str, source: Source, inputs: dict[str, ShaderConnection]) -> Signal:
        """Return the lookup of an image node; its default where it has no image that can be read."""
        width = 4 if category in _FOUR_CHANNELS else _output_width(source, category) or 3
        channels = tuple(range(width))
        if category in _FOUR_CHANNELS:
            named = source.output.removeprefix("out")
            channels = (_COMPONENTS[named],) if named in _COMPONENTS else (0, 1, 2)
        default = inputs.get("fallback" if category == "UsdUVTexture" else "default")
        fallback = self._required(default, 0.0).of_width(width).select(channels)
        file = inputs.get("filez" if category == "triplanarprojection" else "file")
        if category in _SIMPLIFIED:
            self._report.omission(source.shader.GetPath(), f"MaterialX node {category!r} is {_SIMPLIFIED[category]}")
        at = self._required(inputs.get("st" if category == "UsdUVTexture" else "texcoord"), None)
        if file is None or not isinstance(file.value, Sdf.AssetPath) or not file.value.path:
            self._report.omission(source.shader.GetPath(), "an image node without a file; its default is used")
            return fallback
        coordinates = self.baker.coordinates(at)
        if coordinates is None:
            text = "texture coordinates that are no affine map of the mesh's are not supported; the mesh's own are used"
            self._report.omission(source.shader.GetPath(), text)
            coordinates = Coordinates()
        coordinates = self._tiled(category, coordinates, inputs)
        if category.startswith("gltf"):
            coordinates = self._gltf_placed(category, source, coordinates, inputs)
        wrap_u, wrap_v = (self._wrap(inputs, axis) for axis in "uv")
        space = _color_space(file, category == "UsdUVTexture" or "color" in source.id)
        if "<UDIM>" in file.value.path:
            found = self._textures.add_udim(file.attribute, file.value, space, (0.0, 0.0, 0.0, 1.0))
            row, window = found or (None, None)
            if window is not None:
                coordinates = coordinates.mapped(np.array([window[:3], window[3:], (0.0, 0.0, 1.0)]))
        else:
            row = self._textures.add(file.attribute, file.value, space, wrap_u, wrap_v, "its default is used")
        if row is None:
            return fallback
        texture = self._textures.textures[row]
        lookup = Signal(
            row=row,
            channels=channels,
            scale=np.ones(len(channels)),
            bias=np.zeros(len(channels)),
            coordinates=coordinates,
            wraps=(texture.wrap_s, texture.wrap_t),
        )
        summand = np.zeros(1)
        if category == "UsdUVTexture":
            summand = self.baker.mean(self._required(inputs.get("bias"), 0.0).of_width(width).select(channels))
        for name in _FACTORS.get(category, ()):
            factor = self._required(inputs.get(name), 1.0).of_width(width).select(channels)
            if factor.constant is None:
                lookup = self.baker.apply(lambda a, b: a * b + summand, lookup, factor)
            else:
                lookup = self.baker.affine(lookup, factor.constant, summand)
        return lookup

    def _gltf_placed(
        self, category: str, source: Source, at: Coordinates, inputs: dict[str, ShaderConnection]
    ) -> Coordinates:
        """Return the coordinates of glTF's image nodes: place2d with the inverse of their scale, turn and offset."""
        pivot, scale, rotate, offset = (
            self.baker.mean(self._required(inputs.get(name), (0.0, 1.0) if name == "pivot" else default))
            for name, default in _PLACE
        )
        order = None if category == "gltf_colorimage" else inputs.get("operationorder")  # its graph does not pass it on
        translate_first = self.baker.mean(self._required(order, 1.0 if "color4" in source.id else 0.0))[0] == 1.0
        scale, offset = 1.0 / np.where(scale == 0.0, 1.0, scale), offset * (-1.0, 1.0)
        return at.mapped(placement(pivot, scale, -rotate, offset, translate_first))

    def _tiled(self, category: str, coordinates: Coordinates, inputs: dict[str, ShaderConnection]) -> Coordinates:
        """Return the coordinates of a tiledimage: times its tiling, minus its offset."""
        if category not in ("tiledimage", "hextiledimage"):
            return coordinates
        tiling, offset, world, tile = (
            self.baker.mean(self._required(inputs.get(name), default).of_width(2))
            for name, default in (
                ("uvtiling" if category == "tiledimage" else "tiling", (1.0, 1.0)),
                ("uvoffset", (0.0, 0.0)),
                ("realworldimagesize", (1.0, 1.0)),
                ("realworldtilesize", (1.0, 1.0)),
            )
        )
        scale = tile / np.where(world == 0.0, 1.0, world)
        return coordinates.mapped(np.diag([*scale, 1.0]) @ shift(*-offset) @ np.diag([*tiling, 1.0]))

    def _wrap(self, inputs: dict[str, ShaderConnection], axis: str) -> str:
        for name in (f"{axis}addressmode", {"u": "wrapS", "v": "wrapT"}[axis]):
            mode = inputs.get(name)
            if mode is not None and mode.value is not None:
                return _WRAPS.get(str(mode.value), str(mode.value))
        return "repeat"


def _report_whitened(surface: Sdf.Path, open_nodes: Sequence[tuple[Sdf.Path, str]], report: StageReport) -> None:
    path = open_nodes[-1][0] if open_nodes else surface
    report.omission(path, "colors of vertices are only scaled and shifted; they count as white here")


def _joined(values: Any) -> Any:
    shape = np.broadcast_shapes(*(each.shape[:-1] for each in values))
    return np.concatenate([np.broadcast_to(each, (*shape, each.shape[-1])) for each in values], axis=-1)


def _extended(values: Any) -> Any:
    """Return vectors of two components with z = 0 and w = 1."""
    return np.concatenate([values, np.broadcast_to((0.0, 1.0), values.shape)], axis=-1)


def _output_width(source: Source, category: str) -> int:
    """Return the components of a node's output, by the type in its id; 0 if that says nothing."""
    if category.startswith("separate") or category in _NUMBERS:
        return 1
    if category == "normalmap":  # its id has the type of its scale
        return 3
    kinds = source.id.removeprefix("ND_").removeprefix(category).strip("_").split("_")
    named = [_WIDTHS[each.removesuffix("FA")] for each in kinds if each.removesuffix("FA") in _WIDTHS]
    return named[-1] if named else 0


def _color_space(file: ShaderConnection, is_color: bool) -> str:
    """Return the color space of an image node's file, as `TextureTable.add` names it: vectors are raw."""
    name = file.attribute.GetColorSpace()
    if not name:
        return "auto" if is_color else "raw"
    space = color_space(name)
    if space == SRGB:
        return "sRGB"
    return space if is_color and space != LINEAR else "raw"


def vertex_colors(width: int) -> Signal:
    """Return the vertices' colors (three components) or opacity (one) as a signal."""
    channels = (3,) if width == 1 else (0, 1, 2)
    return Signal(row=VERTEX_COLORS, channels=channels, scale=np.ones(len(channels)), bias=np.zeros(len(channels)))
