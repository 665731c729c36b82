# SPDX-License-Identifier: Apache-2.0
"""glTF files: attributes, samplers, transforms of textures, sparse accessors, skins, morph targets and animations."""

from __future__ import annotations

import base64
import io
import json
import math
import struct
import warnings

import numpy as np
import pytest
from PIL import Image

from tiscene.errors import StageError, StageWarning
from tiscene.scene.description import VERTEX_COLORS, TextureLookup
from tiscene.usd.importers.gltf import GltfDocument
from tiscene.usd.importers.import_template import import_asset
from tiscene.usd.read.template import read_template

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
KINDS = {np.dtype("<f4"): 5126, np.dtype("u1"): 5121, np.dtype("<u2"): 5123, np.dtype("i1"): 5120}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Builder:
    """A glTF file of one triangle, to which tests add accessors and entries."""

    def __init__(self) -> None:
        self.data = b""
        self.views: list[dict] = []
        self.accessors: list[dict] = []
        self.attributes = {"POSITION": self.add(TRIANGLE)}
        self.primitive = {"attributes": self.attributes, "material": 0}
        self.parts = {
            "asset": {"version": "2.0"},
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0, "name": "Thing"}],
            "meshes": [{"primitives": [self.primitive]}],
            "materials": [{"name": "Paint"}],
        }

    def view(self, data: bytes) -> int:
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)})
        self.data += data + b"\0" * (-len(data) % 4)
        return len(self.views) - 1

    def add(self, values, dtype="<f4", **more) -> int:
        array = np.asarray(values, dtype)
        array = array.reshape(len(array), -1)
        entry = {"bufferView": self.view(array.tobytes()), "componentType": KINDS[array.dtype], "count": len(array)}
        self.accessors.append(entry | {"type": TYPES[array.shape[1]]} | more)
        return len(self.accessors) - 1

    def picture(self, **texture) -> dict:
        """Add an image of 2 x 1 pixels as a texture; returns its texture info."""
        buffer = io.BytesIO()
        Image.fromarray(np.array([[[255, 0, 0], [0, 0, 255]]], np.uint8)).save(buffer, "PNG")
        uri = "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()
        self.parts.setdefault("images", []).append({"uri": uri})
        textures = self.parts.setdefault("textures", [])
        textures.append({"source": len(self.parts["images"]) - 1} | texture)
        if "TEXCOORD_0" not in self.attributes:
            self.attributes["TEXCOORD_0"] = self.add([[0, 0], [1, 0], [0, 1]])
        return {"index": len(textures) - 1}

    def content(self) -> dict:
        uri = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        buffers = [{"uri": uri, "byteLength": len(self.data)}]
        return self.parts | {"buffers": buffers, "bufferViews": self.views, "accessors": self.accessors}

    def read(self, folder, expected: str = ""):
        """Import the file and return the template's description; warnings must match `expected`."""
        path = folder / "thing.gltf"
        path.write_text(json.dumps(self.content()))
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            template = import_asset(path, folder / "out", centered=False)
        texts = [str(each.message) for each in caught if isinstance(each.message, StageWarning)]
        assert "\n".join(texts) == expected
        return read_template(template).description


@pytest.fixture
def builder() -> Builder:
    return Builder()


def test_vertex_colors_multiply_the_base_color(builder, tmp_path):
    builder.attributes["COLOR_0"] = builder.add(
        [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 51]], "u1", normalized=True
    )
    factor = {"baseColorFactor": [0.5, 1, 1, 1], "metallicFactor": 0, "roughnessFactor": 0.25}
    builder.parts["materials"] = [{"name": "Paint", "pbrMetallicRoughness": factor, "alphaMode": "BLEND"}]
    description = builder.read(tmp_path)
    (material,), (mesh,) = description.materials, description.meshes
    assert (material.name, material.roughness, material.opacity_mode) == ("Paint", 0.25, "presence")
    assert material.diffuse_color == TextureLookup(-1)
    assert material.opacity == TextureLookup(-1, "a")
    order = np.argsort(mesh.positions @ [1, 2, 0])
    np.testing.assert_allclose(mesh.colors[order], [[0.5, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 0.2]], atol=1e-6)


def test_vertex_colors_multiply_a_texture(builder, tmp_path):
    builder.parts["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": builder.picture()}}]
    builder.attributes["COLOR_0"] = builder.add([[0.5, 1, 0.25]] * 3)
    assert builder.read(tmp_path).materials[0].diffuse_color.scale[:3] == (0.5, 1.0, 0.25)
    builder.attributes["COLOR_0"] = builder.add(np.eye(3))
    builder.parts["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [0.5, 1, 1, 1]
    description = builder.read(tmp_path)
    lookup, (mesh,) = description.materials[0].diffuse_color, description.meshes
    assert (lookup.vertex_factor, lookup.scale) == ("rgb", (1.0,) * 4)
    assert lookup.texture >= 0
    order = np.argsort(mesh.positions @ [1, 2, 0])
    np.testing.assert_allclose(mesh.colors[order][:, :3], np.diag([0.5, 1, 1]), atol=1e-6)
    builder.parts["materials"][0]["alphaMode"] = "BLEND"
    builder.attributes["COLOR_0"] = builder.add([[1, 1, 1, 1], [1, 1, 1, 0.5], [1, 1, 1, 0]])
    text = "thing.gltf: not imported: opacities of vertices of materials with an opacity texture"
    builder.read(tmp_path, text)


def test_wrap_modes_second_coordinates_and_normal_scale(builder, tmp_path):
    builder.parts["samplers"] = [{"wrapS": 33071, "wrapT": 33648}]
    builder.attributes["TEXCOORD_1"] = builder.add([[0.25, 0], [0.5, 0], [0.75, 1]])
    color, bumps = builder.picture(sampler=0), builder.picture()
    builder.parts["materials"] = [
        {"pbrMetallicRoughness": {"baseColorTexture": color | {"texCoord": 1}}, "normalTexture": bumps | {"scale": 0.5}}
    ]
    description = builder.read(tmp_path)
    (material,), (mesh,) = description.materials, description.meshes
    texture = description.textures[material.diffuse_color.texture]
    assert (texture.wrap_s, texture.wrap_t) == ("clamp", "mirror")
    assert material.diffuse_color.uv_set != material.normal.uv_set
    np.testing.assert_allclose(material.normal.scale[:3], (1.0, 1.0, 2.0))
    np.testing.assert_allclose(material.normal.bias[:3], (-0.5, -0.5, -1.0))
    second = mesh.second_uv if material.diffuse_color.uv_set else mesh.uv
    order = np.argsort(mesh.positions @ [1, 2, 0])
    np.testing.assert_allclose(second[order], [[0.25, 1], [0.5, 1], [0.75, 0]])


def test_texture_transform_keeps_its_meaning_when_v_is_flipped(builder, tmp_path):
    """The specification's example: half-size, turned by 90 degrees, offset (0, 1): the image's lower left quadrant."""
    change = {"offset": [0, 1], "rotation": math.pi / 2, "scale": [0.5, 0.5]}
    info = builder.picture() | {"extensions": {"KHR_texture_transform": change}}
    builder.parts |= {
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": info}}],
        "extensionsUsed": ["KHR_texture_transform"],
    }
    description = builder.read(tmp_path)
    matrix = np.array(description.materials[0].diffuse_color.uv_transform).reshape(2, 3)
    corners = np.array([[0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]]) @ matrix.T  # of USD's uv, v upwards
    np.testing.assert_allclose(sorted(corners.round(6).tolist()), [[0, 0], [0, 0.5], [0.5, 0], [0.5, 0.5]], atol=1e-6)
    # glTF maps (u, v) = (1, 0), top right in its own axes, to (0, -0.5 + 1): with v upwards (1, 1) to (0, 0.5)
    np.testing.assert_allclose(corners[3], (0.0, 0.5), atol=1e-6)


def test_coat_and_transmission_textures(builder, tmp_path):
    extensions = {
        "KHR_materials_clearcoat": {"clearcoatFactor": 0.5, "clearcoatTexture": builder.picture()},
        "KHR_materials_transmission": {"transmissionFactor": 0.5, "transmissionTexture": builder.picture()},
    }
    builder.parts |= {"materials": [{"extensions": extensions}], "extensionsUsed": [*extensions]}
    (material,) = builder.read(tmp_path).materials
    assert (material.clearcoat.channel, material.clearcoat.scale[0]) == ("r", 0.5)
    assert (material.opacity.channel, material.opacity.scale[0], material.opacity.bias[0]) == ("r", -0.5, 1.0)
    assert material.opacity_mode == "transmission"
    assert material.lobes.thin_walled


def test_extensions_beyond_preview_surface_become_lobes(builder, tmp_path):
    """Half of the light remains after 0.25 m; glTF's sheen alpha is the square; strength 0.5 of alpha 0.25."""
    extensions = {
        "KHR_materials_sheen": {"sheenColorFactor": [1, 0.5, 0], "sheenRoughnessFactor": 0.5},
        "KHR_materials_specular": {"specularFactor": 0.5, "specularTexture": builder.picture(),
                                   "specularColorFactor": [0.5, 1, 1]},
        "KHR_materials_transmission": {"transmissionFactor": 1},
        "KHR_materials_volume": {"thicknessFactor": 1, "attenuationDistance": 0.25, "attenuationColor": [0.5, 1, 1]},
        "KHR_materials_anisotropy": {"anisotropyStrength": 0.5, "anisotropyRotation": np.pi / 2},
        "KHR_materials_emissive_strength": {"emissiveStrength": 4},
    }  # fmt: skip
    base = {"metallicFactor": 0, "roughnessFactor": 0.5}
    entry = {"pbrMetallicRoughness": base, "emissiveFactor": [1, 0.5, 0], "extensions": extensions}
    builder.parts |= {"materials": [entry], "extensionsUsed": [*extensions]}
    (material,) = builder.read(tmp_path).materials
    lobes = material.lobes
    assert (lobes.sheen_color, lobes.sheen_roughness) == ((1.0, 0.5, 0.0), 0.25)
    assert lobes.specular_tint == (0.5, 1.0, 1.0)
    assert (lobes.specular.channel, lobes.specular.scale[3]) == ("a", 0.5)
    assert (material.opacity, lobes.thin_walled) == (0.0, False)
    assert lobes.absorption == pytest.approx((np.log(2) / 0.25, 0.0, 0.0))
    assert lobes.rotation == pytest.approx(0.25)
    assert lobes.anisotropy == pytest.approx(1.0 - 0.25 / (0.25 + 0.75 * 0.25), rel=1e-4)
    assert material.emissive_color == (4.0, 2.0, 0.0)


@pytest.mark.parametrize(
    ("mode", "opacity", "threshold"), [("OPAQUE", 1.0, 0.0), ("MASK", 0.25, 0.5), ("BLEND", 0.25, 0.0)]
)
def test_alpha_mode_of_a_material_with_lobes_is_written(builder, tmp_path, mode, opacity, threshold):
    entry = {"alphaMode": mode, "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.25]}}
    entry["extensions"] = {"KHR_materials_sheen": {"sheenColorFactor": [1, 1, 1]}}
    builder.parts |= {"materials": [entry], "extensionsUsed": [*entry["extensions"]]}
    (material,) = builder.read(tmp_path).materials
    assert (material.opacity, material.opacity_threshold, material.lobes.sheen_color) == (
        opacity,
        threshold,
        (1.0,) * 3,
    )


def test_textures_of_lobes_are_left_out_where_the_mesh_lacks_coordinates(builder, tmp_path):
    sheen = {"sheenColorFactor": [1, 0.5, 0], "sheenColorTexture": builder.picture() | {"texCoord": 1}}
    builder.parts |= {"materials": [{"extensions": {"KHR_materials_sheen": sheen}}]}
    text = "thing.gltf: not imported: textures whose coordinates the mesh lacks"
    (material,) = builder.read(tmp_path, text).materials
    assert material.lobes.sheen_color == (1.0, 0.5, 0.0)


def test_vertex_colors_tint_a_material_with_lobes(builder, tmp_path):
    builder.attributes["COLOR_0"] = builder.add([[1, 0, 0], [0, 1, 0], [0, 0, 1]])
    extensions = {"KHR_materials_sheen": {"sheenColorFactor": [1, 1, 1]}}
    builder.parts |= {"materials": [{"extensions": extensions}], "extensionsUsed": [*extensions]}
    (material,) = builder.read(tmp_path).materials
    assert material.diffuse_color.texture == VERTEX_COLORS
    assert material.lobes.sheen_color == (1.0, 1.0, 1.0)


def test_parts_of_extensions_that_are_not_imported_are_named(builder, tmp_path):
    extensions = {
        "KHR_materials_clearcoat": {"clearcoatFactor": 1, "clearcoatNormalTexture": builder.picture()},
        "KHR_materials_anisotropy": {"anisotropyStrength": 1, "anisotropyTexture": builder.picture()},
    }
    builder.parts |= {"materials": [{"extensions": extensions}], "extensionsUsed": [*extensions]}
    names = "directions of KHR_materials_anisotropy's textures, normal maps of KHR_materials_clearcoat"
    builder.read(tmp_path, f"thing.gltf: not imported: {names}")


def test_specular_glossiness_and_unlit_materials(builder, tmp_path):
    glossy = {"diffuseFactor": [0.5, 0.5, 0.5, 1], "specularFactor": [0.25, 0.5, 1], "glossinessFactor": 0.75}
    builder.parts["materials"] = [{"extensions": {"KHR_materials_pbrSpecularGlossiness": glossy}}]
    (material,) = builder.read(tmp_path).materials
    assert (material.use_specular_workflow, material.specular_color) == (True, (0.25, 0.5, 1.0))
    assert (material.diffuse_color, material.roughness) == ((0.5, 0.5, 0.5), 0.25)
    base = {"baseColorFactor": [1, 0.5, 0, 1]}
    builder.parts["materials"] = [{"pbrMetallicRoughness": base, "extensions": {"KHR_materials_unlit": {}}}]
    (material,) = builder.read(tmp_path).materials
    assert (material.diffuse_color, material.emissive_color) == ((0.0, 0.0, 0.0), (1.0, 0.5, 0.0))


def test_sparse_normalized_and_strided_accessors(builder):
    index = builder.add(np.zeros((4, 1), np.float32))
    at, new = builder.view(struct.pack("<2H", 1, 3)), builder.view(struct.pack("<2f", 7, 9))
    sparse = {"count": 2, "indices": {"bufferView": at, "componentType": 5123}, "values": {"bufferView": new}}
    builder.accessors[index]["sparse"] = sparse
    empty = len(builder.accessors)
    builder.accessors.append({"componentType": 5126, "count": 4, "type": "SCALAR", "sparse": sparse})
    bytes_ = builder.add([[-128], [127], [0]], "i1", normalized=True)
    strided = len(builder.accessors)
    view = builder.view(struct.pack("<4f", 1, 2, 3, 4))
    builder.views[view]["byteStride"] = 8
    builder.accessors.append({"bufferView": view, "componentType": 5126, "count": 2, "type": "SCALAR"})
    document = GltfDocument(builder.content(), b"", lambda name: b"")
    assert document.accessor(index)[:, 0].tolist() == document.accessor(empty)[:, 0].tolist() == [0, 7, 0, 9]
    assert document.accessor(bytes_)[:, 0].tolist() == [-1.0, 1.0, 0.0]
    assert document.accessor(strided)[:, 0].tolist() == [1.0, 3.0]
    builder.accessors[strided]["count"] = 3
    with pytest.raises(ValueError, match="too short for 3 elements"):
        GltfDocument(builder.content(), b"", lambda name: b"").accessor(strided)


@pytest.mark.parametrize(
    ("mode", "expected"), [(4, [[0, 1, 2]]), (5, [[0, 1, 2], [2, 1, 3]]), (6, [[0, 1, 2], [0, 2, 3]])]
)
def test_strips_and_fans_become_triangles(builder, tmp_path, mode, expected):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], np.float32)
    builder.attributes["POSITION"] = builder.add(points if mode != 4 else TRIANGLE)
    builder.primitive["mode"] = mode
    mesh = builder.read(tmp_path).meshes[0]
    found = {tuple(sorted(map(tuple, mesh.positions[each].tolist()))) for each in mesh.triangles}
    assert found == {tuple(sorted(map(tuple, points[each].tolist()))) for each in expected}


def test_skinned_mesh_is_posed_by_its_joints_at_rest(builder, tmp_path):
    """The second joint is 2 up; its inverse bind matrix moves by 1 down: vertices bound to it move by 1 up."""
    builder.attributes["JOINTS_0"] = builder.add([[0, 1, 0, 0]] * 3, "u1")
    builder.attributes["WEIGHTS_0"] = builder.add([[1, 0, 0, 0], [0.5, 0.5, 0, 0], [0, 1, 0, 0]])
    binds = np.tile(np.eye(4), (2, 1, 1))
    binds[1, 1, 3] = -1.0
    inverse = builder.add(binds.transpose(0, 2, 1).reshape(2, 16))
    builder.parts |= {
        "nodes": [{"mesh": 0, "skin": 0, "translation": [9, 9, 9]}, {"children": [2]}, {"translation": [0, 2, 0]}],
        "scenes": [{"nodes": [0, 1]}],
        "skins": [{"joints": [1, 2], "inverseBindMatrices": inverse}],
    }
    positions = builder.read(tmp_path).meshes[0].positions
    np.testing.assert_allclose(sorted(positions.tolist()), [[0, 0, 0], [0, 2, 0], [1, 0.5, 0]], atol=1e-6)


def test_animation_of_nodes_and_morph_targets_plays(builder, tmp_path):
    """One second: the node moves by 3 along x, and the target, which lifts the third vertex by 2, goes from 0 to 1."""
    builder.primitive["targets"] = [{"POSITION": builder.add([[0, 0, 0], [0, 0, 0], [0, 2, 0]])}]
    times, moves, weights = builder.add([0, 1]), builder.add([[0, 0, 0], [3, 0, 0]]), builder.add([0, 1])
    builder.parts["animations"] = [
        {
            "samplers": [{"input": times, "output": moves}, {"input": times, "output": weights}],
            "channels": [
                {"sampler": 0, "target": {"node": 0, "path": "translation"}},
                {"sampler": 1, "target": {"node": 0, "path": "weights"}},
            ],
        }
    ]
    mesh = builder.read(tmp_path).meshes[0]
    shape = mesh.deformation
    assert (shape.times[0], shape.times[-1], len(shape.times)) == (0.0, 1.0, 31)
    third = int(mesh.positions[:, 1].argmax())
    np.testing.assert_allclose(shape.positions[[0, 15, 30], third], [(0, 1, 0), (1.5, 2, 0), (3, 3, 0)], atol=1e-5)


@pytest.mark.parametrize(
    ("mode", "values", "half"),
    [
        ("STEP", [[0, 0, 0], [4, 0, 0]], 0.0),
        ("LINEAR", [[0, 0, 0], [4, 0, 0]], 2.0),
        # in tangent, value, out tangent of each key: 4 (3/4 - 1/4) + 1/8 * 8 - 1/8 * 0 = 3
        ("CUBICSPLINE", [[0, 0, 0], [0, 0, 0], [8, 0, 0], [0, 0, 0], [4, 0, 0], [0, 0, 0]], 3.0),
    ],
)
def test_interpolation_of_animations(builder, tmp_path, mode, values, half):
    sampler = {"input": builder.add([0, 1]), "output": builder.add(values), "interpolation": mode}
    channels = [{"sampler": 0, "target": {"node": 0, "path": "translation"}}]
    builder.parts["animations"] = [{"samplers": [sampler], "channels": channels}]
    mesh = builder.read(tmp_path).meshes[0]
    first = int((mesh.positions**2).sum(axis=1).argmin())
    assert mesh.deformation.positions[15, first, 0] == pytest.approx(half, abs=1e-5)


def test_mirroring_node_keeps_faces_outward(builder, tmp_path):
    builder.attributes["NORMAL"] = builder.add([[0, 0, 1]] * 3)
    builder.parts["nodes"] = [{"mesh": 0, "scale": [-1, 1, 1]}]
    mesh = builder.read(tmp_path).meshes[0]
    a, b, c = mesh.positions[mesh.triangles[0]]
    assert np.cross(b - a, c - a)[2] > 0
    np.testing.assert_allclose(mesh.normals, [[0, 0, 1]] * 3, atol=1e-6)


def test_what_is_not_imported_is_named(builder, tmp_path):
    builder.parts["meshes"][0]["primitives"].append({"attributes": {"POSITION": 0}, "mode": 0})
    builder.parts |= {"cameras": [{}], "extensionsUsed": ["KHR_materials_iridescence", "KHR_materials_ior"]}
    builder.parts |= {"animations": [{"channels": [], "samplers": []}] * 2}
    text = "KHR_materials_iridescence, cameras, animations after the first, points and lines"
    builder.read(tmp_path, f"thing.gltf: not imported: {text}")


def test_missing_image_is_named_and_the_rest_imported(builder, tmp_path):
    info = builder.picture()
    builder.parts["images"][0] = {"uri": "gone.png"}
    builder.parts["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": info, "roughnessFactor": 0.5}}]
    description = builder.read(tmp_path, "thing.gltf refers to missing files: gone.png")
    assert description.materials[0].roughness == 0.5


def test_broken_image_is_named_and_the_rest_imported(builder, tmp_path):
    """Pillow raises SyntaxError where no chunk follows the first byte of the pixels."""
    info = builder.picture()
    data = bytearray(base64.b64decode(builder.parts["images"][0]["uri"].partition(",")[2]))
    at = data.index(b"IDAT")
    data[at - 4 : at] = struct.pack(">I", 1)
    (tmp_path / "broken.png").write_bytes(data)
    builder.parts["images"][0] = {"uri": "broken.png"}
    builder.parts["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": info, "roughnessFactor": 0.5}}]
    description = builder.read(tmp_path, "thing.gltf refers to missing files: broken.png")
    assert description.materials[0].roughness == 0.5


@pytest.mark.parametrize(
    "damage",
    [
        {"nodes": [{"mesh": 7}]},
        {"nodes": [{"mesh": 0, "children": [0]}]},
        {"scenes": [{"nodes": [5]}]},
        {"meshes": [{"primitives": [{"attributes": {"POSITION": 99}}]}]},
        {"meshes": 3},
        {"materials": [{"pbrMetallicRoughness": {"baseColorFactor": [1]}}]},
        {"animations": [{"channels": [{"sampler": 4, "target": {"node": 0, "path": "scale"}}], "samplers": []}]},
    ],
    ids=str,
)
def test_damaged_file_raises_stage_error(builder, tmp_path, damage):
    builder.parts |= damage
    with pytest.raises(StageError, match=r"thing\.gltf has 1 problem"):
        builder.read(tmp_path)
