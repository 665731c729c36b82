# SPDX-License-Identifier: Apache-2.0
"""MaterialX documents (.mtlx) as USD layers, for stages that reference them: the installed USD library reads none.

Each material becomes /MaterialX/Materials/NAME, as OpenUSD's own reader places it, with a shader for every node that it
uses. Node graphs and nodes that the document itself defines are expanded. `substitute_documents` lets the layers of a
stage refer to these layers in memory; no file changes.
"""

from __future__ import annotations

import hashlib
import os
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, replace
from typing import Any

from pxr import Gf, Sdf, Tf, Usd, UsdShade

from dynamics.lru_cache import LRUCache
from tiscene.usd.core.package import split_package
from tiscene.usd.materials.materialx_file import FILE, Element, anchored, read_document
from tiscene.usd.materials.materialx_units import ANGLES, METERS, UNIT

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
# Nodes in place of the inputs of own definitions that have a property of the mesh by default.
_GEOMETRY = {
    "UV0": "ND_texcoord_vector2",
    **dict.fromkeys(("Nobject", "Nworld"), "ND_normal_vector3"),
    **dict.fromkeys(("Tobject", "Tworld"), "ND_tangent_vector3"),
    **dict.fromkeys(("Pobject", "Pworld"), "ND_position_vector3"),
}
_MAX_NODES = 20_000  # of a material; a document that expands to more is damaged
_MAX_DEPTH = 64
_MAX_LAYERS = 256  # kept in memory, those used last
_MAX_NAMED = 5  # inputs named by a message
_SURFACE = "surface"
_UNDRAWN = ("displacement", "volume", "backsurface")  # further shaders of a material
_INPUTS = ("input", "bindinput", "parameter")  # the latter two of version 1.37 and before
DOCUMENT = "materialx"  # in the customLayerData of a layer that was converted, the path of the .mtlx file
_layers: LRUCache[tuple[str, bytes], tuple[Sdf.Layer, tuple[str, ...]]] = LRUCache(_MAX_LAYERS)
_substituted: set[str] = set()  # identifiers of layers that refer to converted documents


def substitute_documents(stage: Usd.Stage, allowed: Any) -> list[tuple[str, str]]:
    """Let the layers of a stage refer to converted .mtlx files, in memory.

    Args:
        stage: the stage.
        allowed: function that returns whether a file may be read.

    Returns:
        The files that cannot be read as a whole, and what is wrong with them.
    """
    faults = []
    for layer in sorted(stage.GetUsedLayers(), key=lambda each: str(each.identifier)):
        for asset in sorted(layer.GetCompositionAssetDependencies()) if not layer.anonymous else ():
            if not asset.partition(":SDF_FORMAT_ARGS:")[0].lower().endswith(".mtlx"):
                continue
            path = layer.ComputeAbsolutePath(asset)
            if not os.path.exists(split_package(path)[0]) or not allowed(path):
                continue  # USD reports it as an asset that is missing
            try:
                converted, broken = layer_of_document(path, allowed)
                faults += [(path, each) for each in broken]
            except (ValueError, OSError) as error:
                faults.append((path, f"cannot be read: {error}"))
                continue
            layer.UpdateCompositionAssetDependency(asset, converted.identifier)
            _substituted.add(layer.identifier)
    return faults


def is_substituted(layer: Sdf.Layer) -> bool:
    """Return whether a layer has been changed in memory by `substitute_documents`, and by nothing else."""
    return layer.identifier in _substituted


def layer_of_document(path: str, allowed: Any) -> tuple[Sdf.Layer, tuple[str, ...]]:
    """Return a .mtlx file as an anonymous layer, the same one while its text does not change, and what is broken in it.

    Args:
        path: of the file.
        allowed: function that returns whether a file that it includes may be read.

    Raises:
        ValueError: the file is not a MaterialX document.
    """
    root = read_document(path, allowed)
    digest = hashlib.blake2b(ElementTree.tostring(root), digest_size=16).digest()
    return _layers.get((path, digest), lambda: _Converter(path, root).result())


@dataclass(frozen=True, eq=False)
class _Scope:
    """Where a node is: its siblings by name, and the values of the interface of the graph around it.

    Attributes:
        nodes: elements by name.
        interface: inputs of the graph's instance by name, each with its own scope.
        prefix: of the names of its shaders.
        colorspace: of colors without one of their own.
        fileprefix: of file names.
        file: that its elements are from.
    """

    nodes: dict[str, Element]
    interface: dict[str, tuple[Element, Any]]
    prefix: str
    colorspace: str
    fileprefix: str
    file: str

    def within(self, element: Element) -> _Scope:
        """Return the scope inside of an element, which may have a color space, a file prefix and a file of its own."""
        return replace(
            self,
            colorspace=element.get("colorspace", self.colorspace),
            fileprefix=element.get("fileprefix", self.fileprefix),
            file=element.get(FILE, self.file),
        )


_Found = tuple[Element, _Scope, str]  # a node, its scope and the name of its output


class _Converter:
    """Converts one document.

    Args:
        path: of its file.
        root: its root element.
    """

    def __init__(self, path: str, root: Element) -> None:
        self._root = root
        self._broken: list[str] = []
        self._malformed: dict[str, None] = {}  # inputs
        self._layer = Sdf.Layer.CreateAnonymous(".usda")  # a stage alone would not keep its layer
        self._layer.customLayerData = {DOCUMENT: path}
        self._stage = Usd.Stage.Open(self._layer)
        self._top = _Scope(_by_name(root), {}, "", "", "", path).within(root)
        self._graphs = {each.get("nodedef", ""): each for each in root.findall("nodegraph") if each.get("nodedef")}
        for each in root.findall("implementation"):
            graph = self._top.nodes.get(each.get("nodegraph", ""))
            if graph is not None:
                self._graphs.setdefault(each.get("nodedef", ""), graph)
        self._definitions = [each for each in root.findall("nodedef") if each.get("name") in self._graphs]
        self._done: dict[str, UsdShade.Shader] = {}

    def result(self) -> tuple[Sdf.Layer, tuple[str, ...]]:
        """Return the layer, and what is wrong with the document."""
        prim = self._stage.DefinePrim("/MaterialX")
        self._stage.DefinePrim("/MaterialX/Materials", "Scope")
        self._stage.SetDefaultPrim(prim)
        for element in self._root:
            if element.tag in ("surfacematerial", "volumematerial"):
                given = {
                    str(each.get("name")).removesuffix("shader"): each for each in _inputs(element, self._top.nodes)
                }
                sources = {kind: self._source(given.get(kind), self._top) for kind in (_SURFACE, *_UNDRAWN)}
                if any(sources.values()):
                    self._material(element, sources.pop(_SURFACE), sources)
            elif element.tag == "material":  # of version 1.36 and before
                for shader in element.findall("shaderref")[:1]:
                    self._material(element, (shader, self._top, "out"), {})
        return self._layer, tuple(self._faults())

    def _faults(self) -> list[str]:
        """Return what is wrong with the document: materials that are left out, and inputs that keep their defaults."""
        names = list(self._malformed)
        more = f" and {len(names) - _MAX_NAMED} more" if len(names) > _MAX_NAMED else ""
        text = f"has values of another type than their inputs: {', '.join(names[:_MAX_NAMED])}{more}"
        return [*self._broken, *([text] if names else [])]

    def _material(self, element: Element, surface: _Found | None, others: dict[str, _Found | None]) -> None:
        """Define a material with its surface; `others` are not drawn, and reported where the material is read."""
        name = Tf.MakeValidIdentifier(element.get("name", "Material"))
        material = UsdShade.Material.Define(self._stage, f"/MaterialX/Materials/{name}")
        self._done = {}
        if surface is not None:
            try:
                shader = self._shader(material.GetPath(), surface[0], surface[1], 0)
            except ValueError as error:
                self._broken.append(f"cannot be read: material {element.get('name')!r}: {error}")
                return
            output = shader.CreateOutput("out", Sdf.ValueTypeNames.Token)
            material.CreateSurfaceOutput("mtlx").ConnectToSource(output)
        for kind, found in others.items():
            if found is not None:
                path = material.GetPath().AppendChild(Tf.MakeValidIdentifier(found[0].get("name", kind)))
                output = UsdShade.Shader.Define(self._stage, path).CreateOutput("out", Sdf.ValueTypeNames.Token)
                material.CreateOutput(f"mtlx:{kind}", Sdf.ValueTypeNames.Token).ConnectToSource(output)

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
        for each in _inputs(node, scope.nodes):
            self._author(shader, each, scope.within(node), depth)
        return shader

    def _author(self, shader: UsdShade.Shader, element: Element, scope: _Scope, depth: int) -> None:
        """Author an input: its value, or a connection to the shader that it gets its value from."""
        declared = element.get("type", "")
        kind = _TYPES.get(declared, Sdf.ValueTypeNames.String)
        target = shader.CreateInput(element.get("name", "in"), kind)
        while element.get("interfacename") and element.get("interfacename") in scope.interface:
            element, scope = scope.interface[element.get("interfacename", "")]
        found = self._source(element, scope)
        if found is not None:
            node, inner, name = found
            source = self._shader(shader.GetPath().GetParentPath(), node, inner, depth + 1)
            if element.get("channels"):  # of version 1.38 and before
                given = source.CreateOutput(name, _TYPES.get(node.get("type", ""), kind))
                path = shader.GetPath().GetParentPath().AppendChild(f"{shader.GetPath().name}_{target.GetBaseName()}")
                source, name = UsdShade.Shader.Define(self._stage, path), "out"
                source.CreateIdAttr(f"ND_swizzle_{node.get('type')}_{element.get('type')}")
                source.CreateInput("in", given.GetTypeName()).ConnectToSource(given)
                source.CreateInput("channels", Sdf.ValueTypeNames.String).Set(element.get("channels"))
            target.ConnectToSource(source.CreateOutput(name, kind))
            return
        value = element.get("value")
        if not value:  # empty: baked documents write all inputs
            geometry = _GEOMETRY.get(element.get("defaultgeomprop", ""))
            if geometry is not None:
                path = shader.GetPath().GetParentPath().AppendChild(f"default_{element.get('defaultgeomprop')}")
                source = UsdShade.Shader.Define(self._stage, path)
                source.CreateIdAttr(geometry)
                target.ConnectToSource(source.CreateOutput("out", kind))
            return
        if kind == Sdf.ValueTypeNames.Asset:
            prefix = element.get("fileprefix", scope.fileprefix)
            target.Set(Sdf.AssetPath(anchored(prefix + value, scope.file)))
        else:
            try:
                target.Set(_parsed(value, declared))
            except ValueError as error:
                self._malformed[f"{element.get('name')} of {shader.GetPath().name} ({error})"] = None
                return
        if element.get("unit") in (*METERS, *ANGLES):
            target.GetAttr().SetCustomDataByKey(UNIT, element.get("unit"))
        space = element.get("colorspace") or (scope.colorspace if element.get("type") in ("color3", "color4") else "")
        if kind == Sdf.ValueTypeNames.Asset and not space:
            is_color = "color" in str(shader.GetIdAttr().Get())
            space = scope.colorspace if is_color else "raw"
            target.GetAttr().SetColorSpace(space or "raw")
        elif space:
            target.GetAttr().SetColorSpace(space)

    def _source(self, element: Element | None, scope: _Scope, depth: int = 0) -> _Found | None:
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
            definition = self._definition(node)
            if definition is None:
                return node, scope, output
            return self._graph_output(self._graphs[definition.get("name", "")], node, scope, output, depth, definition)
        named = scope.nodes.get(output) if element.get("output") and not element.get("value") else None
        return self._source(named, scope, depth + 1) if named is not None and named.tag == "output" else None

    def _definition(self, node: Element) -> Element | None:
        """Return the document's own definition of a node: the one that it names, else one that has its types."""
        types = {(each.get("name"), each.get("type")) for each in node.findall("input")}
        for each in self._definitions:
            if node.get("nodedef", each.get("name")) != each.get("name") or node.tag != each.get("node"):
                continue
            inputs = {(given.get("name"), given.get("type")) for given in _inputs(each, self._top.nodes)}
            kinds = [x.get("type") for own in _lineage(each, self._top.nodes) for x in own.findall("output")]
            outputs = {"multioutput", *kinds}
            if node.get("nodedef") or (types <= inputs and node.get("type") in outputs):
                return each
        return None

    def _graph_output(
        self,
        graph: Element,
        instance: Element,
        scope: _Scope,
        output: str,
        depth: int,
        definition: Element | None = None,
    ) -> _Found | None:
        """Return the node behind an output of a node graph.

        Args:
            graph: the graph.
            instance: the element that gives its interface values: the graph itself, or a node that it implements.
            scope: of the instance.
            output: name of the output.
            depth: of nesting.
            definition: of the node that the graph implements, with the defaults of its inputs.
        """
        outer, interface, around = scope.within(instance), {}, scope
        if definition is not None:
            around, defaults = self._top, self._top.within(definition)
            interface = {each.get("name", ""): (each, defaults) for each in _inputs(definition, self._top.nodes)}
        interface |= {each.get("name", ""): (each, outer) for each in _inputs(instance, scope.nodes)}
        prefix = f"{scope.prefix}{instance.get('name', 'graph')}_"
        inner = replace(around.within(graph), nodes=_by_name(graph), interface=interface, prefix=prefix)
        outputs = graph.findall("output")
        chosen = next((each for each in outputs if each.get("name") == output), outputs[0] if outputs else None)
        return self._source(chosen, inner, depth + 1)


def _by_name(element: Element) -> dict[str, Element]:
    return {each.get("name", ""): each for each in element}


def _inputs(element: Element, siblings: dict[str, Element]) -> list[Element]:
    """Return the inputs of an element, then those that it inherits from siblings."""
    found: dict[str, Element] = {}
    for each in _lineage(element, siblings):
        for given in (given for tag in _INPUTS for given in each.findall(tag)):
            found.setdefault(given.get("name", ""), given)
    return list(found.values())


def _lineage(element: Element, siblings: dict[str, Element]) -> list[Element]:
    """Return an element, then those that it inherits from."""
    found = [element]
    while (parent := siblings.get(found[-1].get("inherit", ""))) is not None and parent not in found:
        found.append(parent)
    return found


def _parsed(value: str, kind: str) -> Any:
    """Return a value of a MaterialX type.

    Raises:
        ValueError: the text is not of that type.
    """
    try:
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
    except ValueError:
        pass
    raise ValueError(f"{value!r} is not a {kind}")
