# SPDX-License-Identifier: Apache-2.0
"""Cryptomatte export: published hashes, file contents, and mattes compared with labels."""

import json
import math
import struct
from types import SimpleNamespace

import numpy as np
import OpenEXR
import pytest

from tests.export.fake_stream import FakeStream
from tiscene.errors import BufferNotFound, ExportError, MissingFile
from tiscene.export import cryptomatte
from tiscene.export.array_files import resolved
from tiscene.export.cryptomatte import decode, hash_of, murmur3

HEIGHT, WIDTH = 3, 4
LAYERS = ("CryptoObject", "CryptoAsset", "CryptoMaterial", "CryptoCategory")


def row(id, name, category="", prim_path="", asset="", template=""):
    return SimpleNamespace(id=id, name=name, category=category, prim_path=prim_path, asset=asset, template=template)


OBJECTS = (
    row(1, "Wall", "structure", "/Room/Wall"),
    row(2, "left", "chair", "/Room/Left", "Oak Chair"),
    row(7, 'Mädchen, the "2nd"', "chair", "", "Oak Chair"),
    row(9, "nobody", "ghost", "/Room/Nobody"),
    row(10, "Mover", "ghost", template="/Room/Mover"),  # a dynamic prim of the stage
    row(11, "again", "ghost", template="/Room/Mover"),  # a second object of the same prim
)


MATERIALS = {0: "", 1: "/Looks/Plaster", 2: "Oak Chair/Looks/Oak", 3: "displayColor"}


def frame(coverage, **buffers):
    """Return a frame whose wall is of plaster, the left chair of oak, the other one without a material."""
    ids = np.select([coverage[..., 0] == id for id in (1, 2, 7)], [1, 2, 3], 0)
    of_materials = np.stack([ids, coverage[..., 1]], axis=-1).astype(np.float32)
    return SimpleNamespace(
        index=12, objects=OBJECTS, coverage=coverage, material_coverage=of_materials, materials=MATERIALS,
        buffers={"coverage": coverage, "material_coverage": of_materials, **buffers},
    )  # fmt: skip


@pytest.fixture
def coverage():
    """Left half: wall. Third column: wall, both chairs and background. Right column: background."""
    pixels = np.zeros((HEIGHT, WIDTH, 6, 2), np.float32)
    pixels[:, :2, 0] = 1, 1.0
    pixels[:, 2, 0], pixels[:, 2, 1], pixels[:, 2, 2] = (1, 0.375), (2, 0.25), (7, 0.1875)
    return pixels


@pytest.fixture
def written(tmp_path, coverage):
    hdr = np.full((HEIGHT, WIDTH, 3), 2.5, np.float32)
    ((name, data),) = resolved(cryptomatte.encode(frame(coverage, hdr=hdr))).items()
    assert name == "000012.exr"
    (tmp_path / name).write_bytes(data)
    return tmp_path / name


def as_float(bits):
    return struct.unpack("<f", struct.pack("<I", bits))[0]


def test_hashes_are_those_of_the_reference_tools():
    # From the tests of Psyop's Nuke tools.
    expected = {
        "hello": 6.07056271024e-17, "cube": -4.08461912519e15, "sphere": 2.79018604383e15, "plane": 3.66557617593e-11,
        "равнина": -1.31926312125e-25, "mädchen": 6.23612982120e25,
    }  # fmt: skip
    for name, value in expected.items():
        assert as_float(hash_of(name)) == pytest.approx(value, rel=1e-6), name
    assert f"{hash_of('bunny'):08x}" == "13851a76"  # the example in the specification
    assert f"{hash_of('default'):08x}" == "42c9679f"
    assert murmur3(b"") == 0


def test_hashes_are_normal_floats():
    values = [as_float(hash_of(f"object {number}")) for number in range(5000)]
    assert all(math.isfinite(value) and abs(value) >= 2.0**-126 for value in values)
    exponents = [murmur3(f"object {number}".encode()) >> 23 & 0xFF for number in range(5000)]
    assert 0 in exponents
    assert 255 in exponents  # both are replaced


def test_file_has_the_channels_and_attributes_of_the_specification(written):
    with OpenEXR.File(str(written), separate_channels=True) as file:
        assert len(file.parts) == 1
        header, channels, compression = dict(file.header()), file.channels(), file.parts[0].compression()
        types = {name: channel.pixels.dtype for name, channel in channels.items()}
    assert compression == OpenEXR.ZIP_COMPRESSION  # lossless
    for layer in LAYERS:
        key = f"{murmur3(layer.encode()):08x}"[:7]
        assert header[f"cryptomatte/{key}/name"] == layer
        assert header[f"cryptomatte/{key}/hash"] == "MurmurHash3_32"
        assert header[f"cryptomatte/{key}/conversion"] == "uint32_to_float32"
        for level in ("00", "01", "02"):
            assert all(types[f"{layer}{level}.{channel}"] == np.float32 for channel in "RGBA")
    assert {types[channel] for channel in "RGB"} == {np.dtype(np.float16)}
    manifest = json.loads(header[f"cryptomatte/{murmur3(b'CryptoObject'):08x}"[:19] + "/manifest"])
    assert manifest["/Room/Left"] == f"{hash_of('/Room/Left'):08x}"
    names = {"/Room/Wall", "/Room/Left", 'Mädchen, the "2nd"', "/Room/Nobody", "/Room/Mover", "again"}
    assert set(manifest) == names


def test_object_mattes_are_the_coverage(written, coverage):
    objects = decode(written)["CryptoObject"]
    for each in OBJECTS[:4]:
        expected = np.where(coverage[..., 0] == each.id, coverage[..., 1], 0.0).sum(axis=-1)
        np.testing.assert_array_equal(objects.matte(each.prim_path or each.name), expected)
    assert (np.diff(objects.weights, axis=-1) <= 0.0).all()
    with pytest.raises(ExportError, match="no matte 'left'; there are"):
        objects.matte("left")


def test_objects_of_one_category_share_a_matte_and_ranks_are_sorted(written):
    categories = decode(written)["CryptoCategory"]
    np.testing.assert_array_equal(categories.matte("chair")[:, 2], 0.4375)
    np.testing.assert_array_equal(categories.matte("structure")[0], [1.0, 1.0, 0.375, 0.0])
    assert not categories.matte("ghost").any()
    np.testing.assert_array_equal(categories.weights[0, 2], [0.4375, 0.375, 0, 0, 0, 0])
    np.testing.assert_array_equal(categories.ids[0, 3], 0)


def test_objects_of_one_asset_share_a_matte(written):
    assets = decode(written)["CryptoAsset"]
    of_none = {"/Room/Wall", "/Room/Nobody", "/Room/Mover", "again"}  # named after the objects
    assert set(assets.names) == {"Oak Chair"} | of_none
    np.testing.assert_array_equal(assets.matte("Oak Chair")[:, 2], 0.4375)
    np.testing.assert_array_equal(assets.weights[0, 2], [0.4375, 0.375, 0, 0, 0, 0])


def test_material_mattes_are_named_by_prim_path(written):
    materials = decode(written)["CryptoMaterial"]
    assert set(materials.names) == {name for name in MATERIALS.values() if name}
    np.testing.assert_array_equal(materials.matte("/Looks/Plaster")[0], [1.0, 1.0, 0.375, 0.0])
    np.testing.assert_array_equal(materials.matte("Oak Chair/Looks/Oak")[0], [0, 0, 0.25, 0])
    np.testing.assert_array_equal(materials.matte("displayColor")[0], [0, 0, 0.1875, 0])


def read_by_the_specification(path):
    """Return weights by set, name and pixel, read value by value: {"CryptoObject": {"/Room/Wall": {(x, y): 0.5}}}."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        header, planes = dict(file.header()), {name: each.pixels for name, each in file.channels().items()}
    result = {}
    for key, layer in header.items():
        if not (key.startswith("cryptomatte/") and key.endswith("/name")):
            continue
        manifest = json.loads(header[key.removesuffix("name") + "manifest"])
        names = {struct.unpack("<f", bytes.fromhex(digits)[::-1])[0]: name for name, digits in manifest.items()}
        found = result[layer] = {name: {} for name in manifest}
        levels = sorted({name.split(".")[0] for name in planes if name.startswith(layer) and name[-4:-2].isdigit()})
        for level in levels:
            for id, weight in ("RG", "BA"):
                ids, weights = planes[f"{level}.{id}"], planes[f"{level}.{weight}"]
                for y, x in np.ndindex(ids.shape):
                    if ids[y, x] != 0.0:
                        mattes = found[names[float(ids[y, x])]]
                        mattes[x, y] = mattes.get((x, y), 0.0) + float(weights[y, x])
    return result


def test_two_exports_have_the_same_bytes(coverage):
    assert resolved(cryptomatte.encode(frame(coverage))) == resolved(cryptomatte.encode(frame(coverage)))


def test_decode_raises_for_files_without_cryptomatte(tmp_path):
    from tiscene.export import exr

    ((name, data),) = resolved(exr.encode(FakeStream(("depth",))[0])).items()
    (tmp_path / name).write_bytes(data)
    with pytest.raises(ExportError, match="has no Cryptomatte"):
        decode(tmp_path / name)
    with pytest.raises(MissingFile, match="no file"):
        decode(tmp_path / "nowhere.exr")


def test_encode_without_coverage_raises_buffer_not_found():
    for buffers in (("depth",), ("coverage",)):
        with pytest.raises(BufferNotFound, match=r"coverage.*Ask for it"):
            resolved(cryptomatte.encode(FakeStream(buffers)[0]))


def test_mattes_of_a_stream_match_its_labels(tmp_path):
    import tiscene as ts
    from tiscene.export import export

    scenario = ts.Scenario(
        "object_view",
        [ts.Object("cube", "Cube", (-0.2, 0.0, 0.0)), ts.Object("dish", "Dish 01", (0.3, 0.1, 0.0), (20, 30, 0))],
        camera=ts.Camera.look_at((0.0, 0.3, 1.6), (0.0, 0.0, 0.0)),
    )
    buffers = ("coverage", "material_coverage")
    stream = ts.Stream(scenario, width=48, height=36, buffers=buffers)
    export(stream, tmp_path, format="cryptomatte", frames=[0])
    sets = decode(tmp_path / "000000.exr")
    frame = ts.Stream(scenario, width=48, height=36, buffers=(*buffers, "instance", "semantic"))[0]
    whole = np.isin(frame.coverage[..., 0, 1], (0.0, 1.0))  # one object, or none
    assert 0.5 < whole.mean() < 1.0
    names = {row.id: row.prim_path or row.name for row in frame.objects}
    assert {"cube", "dish"} <= set(names.values())
    for layer, labels, of in (
        ("CryptoObject", frame.instance, names),
        ("CryptoCategory", frame.semantic, {id: name for id, name in frame.categories.items() if name}),
    ):
        mattes = sets[layer]
        for id, name in of.items():
            if name in mattes.names:
                matte = mattes.matte(name)
                np.testing.assert_array_equal((labels == id)[whole], matte[whole] == 1.0, name)
                assert matte.sum() == pytest.approx(np.count_nonzero(labels == id), rel=0.1, abs=4)
    edge = sets["CryptoObject"].matte("cube")
    assert ((edge > 0.0) & (edge < 1.0)).any()
    again = read_by_the_specification(tmp_path / "000000.exr")
    assert set(again) == set(sets) == set(LAYERS)
    for layer in LAYERS:
        total = np.zeros((36, 48))
        for name, pixels in again[layer].items():
            plain = np.zeros((36, 48))
            for (x, y), weight in pixels.items():
                plain[y, x] = weight
            np.testing.assert_array_equal(plain, sets[layer].matte(name))
            total += plain
        np.testing.assert_array_equal(total, frame.coverage[..., 1].sum(axis=-1), layer)
    assert (total == 1.0).sum() > 50
    assets, materials = sets["CryptoAsset"], sets["CryptoMaterial"]
    np.testing.assert_array_equal(assets.matte("Cube"), edge)
    np.testing.assert_array_equal(assets.matte("Dish 01"), sets["CryptoObject"].matte("dish"))
    of_dish = [name for name in materials.names if name.startswith("Dish 01/")]
    together = sum(materials.matte(name) for name in of_dish)
    np.testing.assert_array_equal(together, sets["CryptoObject"].matte("dish"))
