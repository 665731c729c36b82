# SPDX-License-Identifier: Apache-2.0
"""Import of furniture catalogs of Sweet Home 3D as templates."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest
from PIL import Image
from pxr import Sdf, Usd, UsdPhysics

from tests.usd.importers.test_import_template import BOX, MTL, assert_valid
from tiscene.errors import MissingFile, StageError, StageWarning
from tiscene.usd.importers.sweet_home_3d import FurnitureCatalog, label_of, parse_properties
from tiscene.usd.read.template import read_template

PROPERTIES = """
# comment
name=Test
license=CC0
id#1=a
name#1=Oak chair
category#1=Living \\
   room
model#1=/models/chair/box.obj
width#1=50
height#1=90
depth#1=40
movable#1=true
creator#1=Bj\\u00f6rn
name#2=Wall
model#2=/models/gone.obj
width#2=1
height#2=1
depth#2=1
name#3=Bad
width#3=x
name#4=Turned
model#4=/models/chair/box.obj
modelRotation#4=0 0 1 0 1 0 -1 0 0
width#4=100
height#4=100
depth#4=100
movable#4=false
"""


@pytest.fixture
def furniture_catalog(tmp_path):
    file = tmp_path / "test.sh3f"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("PluginFurnitureCatalog.properties", PROPERTIES)
        archive.writestr("LICENSE.TXT", "All of it.")
        archive.writestr("models/chair/box.obj", BOX)
        archive.writestr("models/chair/box.mtl", MTL)
        archive.writestr("models/chair/license.txt", "This one.")
        picture = io.BytesIO()
        Image.new("RGB", (1, 1)).save(picture, "PNG")
        archive.writestr("models/chair/oak.png", picture.getvalue())
    return file


def test_furniture_catalog_is_imported(furniture_catalog, tmp_path):
    with pytest.warns(StageWarning, match=r"entry 3 \(Bad\) is left out"):
        opened = FurnitureCatalog(furniture_catalog)
    assert [entry.name for entry in opened.entries] == ["Oak chair", "Wall", "Turned"]
    with pytest.warns(StageWarning, match=r"(?s)Wall is left out.*no model 'models/gone.obj'"):
        made = dict(opened.import_into(lambda entry: tmp_path / entry.name))
    paths = {entry.name: path for entry, path in made.items()}
    assert paths["Wall"] is None
    chair = read_template(paths["Oak chair"])
    assert chair.category == "oak chair"
    np.testing.assert_allclose(np.ptp(chair.description.bounds(), axis=0), (0.5, 0.9, 0.4), rtol=1e-6)
    assert len(chair.description.textures) == 1
    layer = Sdf.Layer.FindOrOpen(str(paths["Oak chair"]))
    kept = layer.customLayerData["import"]
    assert kept["author"] == "Björn"
    assert kept["license"] == "CC0\n\nAll of it.\n\nThis one."
    stage = Usd.Stage.Open(str(paths["Turned"]))
    turned = stage.GetDefaultPrim()
    assert not turned.HasAPI(UsdPhysics.RigidBodyAPI)
    assert_valid(paths["Turned"])


def test_invalid_furniture_catalogs_raise(tmp_path):
    with pytest.raises(MissingFile):
        FurnitureCatalog(tmp_path / "gone.sh3f")
    (tmp_path / "bad.sh3f").write_bytes(b"garbage")
    with pytest.raises(StageError, match="not a furniture catalog"):
        FurnitureCatalog(tmp_path / "bad.sh3f")


def test_labels_and_properties_are_parsed():
    assert label_of("Office chair_2 (b)") == "office chair b"
    assert parse_properties("a = b\n! no\n\nc=d\\\n   e") == {"a": "b", "c": "de"}
