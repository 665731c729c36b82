# SPDX-License-Identifier: Apache-2.0
"""MaterialX documents (.mtlx) as USD layers, for stages that reference them: the installed USD library reads none.

Each material becomes /MaterialX/Materials/NAME, as OpenUSD's own reader places it, with a shader for every node that it
uses. Node graphs and nodes that the document itself defines are expanded. `substitute_documents` lets the layers of a
stage refer to these layers in memory; no file changes.
"""

from __future__ import annotations

import os
import posixpath
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from typing import Any

from pxr import Gf, Sdf, Tf, Usd, UsdShade

from dynamics.lru_cache import LRUCache
from tiscene.usd.core.package import split_package
from tiscene.usd.materials.image import read_file

_TYPES = {
    "float": Sdf.ValueTypeNames.Float,
    "integer": Sdf.ValueTypeNames.Int,
    "boolean": Sdf.ValueTypeNames.Bool,
    "color3": Sdf.ValueTypeNames.Color3f,
    "color4": Sdf.ValueTypeNames.Color4f,
    "vector2": Sdf.ValueTypeNames.Float2,
    "vector3": Sdf.ValueTypeNames.Float3,
    "vector4": Sdf.ValueTypeNames.Float4,
    "filename": Sdf.ValueTypeNames.Asset,
}
_VECTORS = {2: Gf.Vec2f, 3: Gf.Vec3f, 4: Gf.Vec4f}
_MAX_NODES = 20_000  # of a material; a document that expands to more is damaged
_MAX_DEPTH = 64
_MAX_LAYERS = 256  # kept in memory, those used last
DOCUMENT = "materialx"  # in the customLayerData of a layer that was converted, the path of the .mtlx file
_layers: LRUCache[tuple[str, float], tuple[Sdf.Layer, tuple[str, ...]]] = LRUCache(_MAX_LAYERS)
_substituted: set[str] = set()  # identifiers of layers that refer to converted documents

Element = ElementTree.Element


def substitute_documents(stage: Usd.Stage, allowed: Any) -> list[tuple[str, str]]:
    """Let the layers of a stage refer to converted .mtlx files, in memory.

    Args:
        stage: the stage.
        allowed: function that returns whether a file may be read.

    Returns:
        The files that cannot be read, and why.
    """
    faults = []
    for layer in stage.GetUsedLayers():
        for asset in sorted(layer.GetCompositionAssetDependencies()) if not layer.anonymous else ():
            if not asset.partition(":SDF_FORMAT_ARGS:")[0].lower().endswith(".mtlx"):
                continue
            path = layer.ComputeAbsolutePath(asset)
            if not os.path.exists(split_package(path)[0]) or not allowed(path):
                continue  # USD reports it as an asset that is missing
            try:
                converted, broken = layer_of_document(path)
                faults += [(path, each) for each in broken]
            except (ValueError, OSError) as error:
                faults.append((path, str(error)))
                continue
            layer.UpdateCompositionAssetDependency(asset, converted.identifier)
            _substituted.add(layer.identifier)
    return faults


def is_substituted(layer: Sdf.Layer) -> bool:
    """Return whether a layer has been changed in memory by `substitute_documents`, and by nothing else."""
    return layer.identifier in _substituted


def layer_of_document(path: str) -> tuple[Sdf.Layer, tuple[str, ...]]:
    """Return a .mtlx file as an anonymous layer, the same one while the file does not change, and its broken materials.

    Raises:
        ValueError: the file is not a MaterialX document.
    """
    return _layers.get((path, os.path.getmtime(split_package(path)[0])), lambda: _converted(path))


def _converted(path: str) -> tuple[Sdf.Layer, tuple[str, ...]]:
    converter = _Converter(path)
    return converter.layer(), tuple(converter.faults)


@dataclass(frozen=True, eq=False)
class _Scope:
    """Where a node is: its siblings by name, and the values of the interface of the graph around it.

    Attributes:
        nodes: elements by name.
        interface: inputs of the graph's instance by name, each with its own scope.
        prefix: of the names of its shaders.
        colorspace: of colors without one of their own.
        fileprefix: of file names.
    """

    nodes: dict[str, Element]
    interface: dict[str, tuple[Element, Any]]
    prefix: str
    colorspace: str
    fileprefix: str


class _Converter:
    """Converts one document. `faults`: its materials that cannot be converted, and why."""

    def __init__(self, path: str) -> None:
        self._path = path
        self.faults: list[str] = []
        try:
            root = ElementTree.fromstring(read_file(path))
        except ElementTree.ParseError as error:
            raise ValueError(f"it is not a MaterialX document: {error}") from None
        if root.tag != "materialx":
            raise ValueError(f"it is not a MaterialX document: its root element is <{root.tag}>")
        self._root = root
        self._layer = Sdf.Layer.CreateAnonymous(".usda")  # a stage alone would not keep its layer
        self._layer.customLayerData = {DOCUMENT: path}
        self._stage = Usd.Stage.Open(self._layer)
        self._top = self._scope(root, {}, "", None)
        self._definitions = {each.get("node", ""): each for each in root.findall("nodedef")}
        self._graphs = {each.get("nodedef", ""): each for each in root.findall("nodegraph") if each.get("nodedef")}
        self._done: dict[str, UsdShade.Shader] = {}

    def layer(self) -> Sdf.Layer:
        """Return the layer."""
        prim = self._stage.DefinePrim("/MaterialX")
        self._stage.DefinePrim("/MaterialX/Materials", "Scope")
        self._stage.SetDefaultPrim(prim)
        for element in self._root:
            if element.tag == "surfacematerial":
                found = self._source(self._input(element, "surfaceshader"), self._top)
                if found is not None:
                    self._material(element, found[0])
            elif element.tag == "material":  # of version 1.36 and before
                for shader in element.findall("shaderref")[:1]:
                    self._material(element, shader)
        return self._layer

    def _material(self, element: Element, surface: Element) -> None:
        name = Tf.MakeValidIdentifier(element.get("name", "Material"))
        material = UsdShade.Material.Define(self._stage, f"/MaterialX/Materials/{name}")
        self._done = {}
        try:
            shader = self._shader(material.GetPath(), surface, self._top, 0)
        except ValueError as error:
            self.faults.append(f"material {element.get('name')!r}: {error}")
            return
        output = shader.CreateOutput("out", Sdf.ValueTypeNames.Token)
        material.CreateSurfaceOutput("mtlx").ConnectToSource(output)

    def _shader(self, parent: Sdf.Path, node: Element, scope: _Scope, depth: int) -> UsdShade.Shader:
        """Define the shader of a node, and those of the nodes that it is connected to."""
        if depth > _MAX_DEPTH or len(self._done) > _MAX_NODES:
            raise ValueError("its nodes are nested without end")
        path = parent.AppendChild(Tf.MakeValidIdentifier(scope.prefix + node.get("name", "node")))
        if str(path) in self._done:
            return self._done[str(path)]
        shader = self._done[str(path)] = UsdShade.Shader.Define(self._stage, path)
        category = node.get("node", "") if node.tag == "shaderref" else node.tag
        kind = "surfaceshader" if node.tag == "shaderref" else node.get("type", "")
        shader.CreateIdAttr(node.get("nodedef") or f"ND_{category}_{kind}")
        for each in (*node.findall("input"), *node.findall("bindinput"), *node.findall("parameter")):
            self._author(shader, each, scope, depth)
        return shader

    def _author(self, shader: UsdShade.Shader, element: Element, scope: _Scope, depth: int) -> None:
        """Author an input: its value, or a connection to the shader that it gets its value from."""
        kind = _TYPES.get(element.get("type", ""), Sdf.ValueTypeNames.String)
        target = shader.CreateInput(element.get("name", "in"), kind)
        while element.get("interfacename") and element.get("interfacename") in scope.interface:
            element, scope = scope.interface[element.get("interfacename", "")]
        found = self._source(element, scope)
        if found is not None:
            node, inner, name = found
            source = self._shader(shader.GetPath().GetParentPath(), node, inner, depth + 1)
            target.ConnectToSource(source.CreateOutput(name, kind))
            return
        value = element.get("value")
        if value is None:
            return
        if kind == Sdf.ValueTypeNames.Asset:
            prefix = element.get("fileprefix", scope.fileprefix)
            target.Set(Sdf.AssetPath(self._anchored(prefix + value)))
        else:
            target.Set(_parsed(value, element.get("type", "")))
        space = element.get("colorspace") or (scope.colorspace if element.get("type") in ("color3", "color4") else "")
        if kind == Sdf.ValueTypeNames.Asset and not space:
            is_color = "color" in str(shader.GetIdAttr().Get())
            space = scope.colorspace if is_color else "raw"
            target.GetAttr().SetColorSpace(space or "raw")
        elif space:
            target.GetAttr().SetColorSpace(space)

    def _source(self, element: Element | None, scope: _Scope, depth: int = 0) -> tuple[Element, _Scope, str] | None:
        """Return the node that an input or output is connected to, its scope and the name of its output."""
        if element is None:
            return None
        if depth > _MAX_DEPTH:
            raise ValueError("its nodes are nested without end")
        output = element.get("output", "out")
        if element.get("nodegraph"):
            graph = scope.nodes.get(element.get("nodegraph", ""), self._top.nodes.get(element.get("nodegraph", "")))
            return None if graph is None else self._graph_output(graph, graph, self._top, output, depth)
        if element.get("nodename"):
            node = scope.nodes.get(element.get("nodename", ""))
            if node is None:
                return None
            if node.tag == "nodegraph":
                return self._graph_output(node, node, scope, output, depth)
            definition = self._definitions.get(node.tag)
            graph = None if definition is None else self._graphs.get(definition.get("name", ""))
            if definition is not None and graph is not None:
                return self._graph_output(graph, node, scope, output, depth, definition)
            return node, scope, output
        named = scope.nodes.get(output) if element.get("output") and not element.get("value") else None
        return self._source(named, scope, depth + 1) if named is not None and named.tag == "output" else None

    def _graph_output(
        self,
        graph: Element,
        instance: Element,
        scope: _Scope,
        output: str,
        depth: int,
        definition: Element | None = None,
    ) -> tuple[Element, _Scope, str] | None:
        """Return the node behind an output of a node graph.

        Args:
            graph: the graph.
            instance: the element that gives its interface values: the graph itself, or a node that it implements.
            scope: of the instance.
            output: name of the output.
            depth: of nesting.
            definition: of the node that the graph implements, with the defaults of its inputs.
        """
        interface = {each.get("name", ""): (each, self._top) for each in (() if definition is None else definition)}
        interface |= {each.get("name", ""): (each, scope) for each in instance.findall("input")}
        inner = self._scope(graph, interface, f"{scope.prefix}{instance.get('name', 'graph')}_", scope)
        outputs = graph.findall("output")
        chosen = next((each for each in outputs if each.get("name") == output), outputs[0] if outputs else None)
        return self._source(chosen, inner, depth + 1)

    def _scope(
        self, element: Element, interface: dict[str, tuple[Element, Any]], prefix: str, outer: _Scope | None
    ) -> _Scope:
        return _Scope(
            {each.get("name", ""): each for each in element},
            interface,
            prefix,
            element.get("colorspace", outer.colorspace if outer else ""),
            element.get("fileprefix", outer.fileprefix if outer else ""),
        )

    @staticmethod
    def _input(element: Element, name: str) -> Element | None:
        return next((each for each in element.findall("input") if each.get("name") == name), None)

    def _anchored(self, file: str) -> str:
        """Return the absolute path of a file that the document names."""
        file = file.replace("\\", "/")
        if os.path.isabs(file) or not file:
            return file
        outer, *inner = split_package(self._path)
        if inner:
            return f"{outer}[{posixpath.normpath(posixpath.join(posixpath.dirname(inner[-1]), file))}]"
        return os.path.normpath(os.path.join(os.path.dirname(self._path), file))


def _parsed(value: str, kind: str) -> Any:
    """Return a value of a MaterialX type.

    Raises:
        ValueError: the text is not of that type.
    """
    if kind == "boolean":
        return value.strip().lower() == "true"
    if kind == "integer":
        return int(value)
    if kind not in _TYPES:
        return value
    numbers = [float(each) for each in re.split(r"[\s,]+", value.strip()) if each]
    if kind == "float" and len(numbers) == 1:
        return numbers[0]
    if kind != "float" and len(numbers) == int(kind[-1]):
        return _VECTORS[len(numbers)](*numbers)
    raise ValueError(f"{value!r} is not a {kind}")
