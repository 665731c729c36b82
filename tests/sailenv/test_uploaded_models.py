# SPDX-License-Identifier: Apache-2.0
"""Uploaded models: import, limits, and unsafe zip files."""

import contextlib
import io
import json
import re
import stat
import struct
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.sailenv.conftest import zipped
from tiscene.errors import ArgumentError, MissingFile, StageError, StageWarning
from tiscene.sailenv import uploaded_models
from tiscene.sailenv.uploaded_models import UploadedModels

SQUARE = (
    "mtllib s.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl red\nf 1/1 2/2 3/3 4/4\n"
)


@pytest.fixture
def uploads():
    uploads = UploadedModels()
    yield uploads
    uploads.close()


def png(color):
    data = io.BytesIO()
    Image.new("RGB", (4, 4), color).save(data, "png")
    return data.getvalue()


def test_uploaded_model_with_a_texture_can_be_spawned(make_agent, tmp_path):
    members = {
        "model/sign.obj": SQUARE,
        "model/s.mtl": "newmtl red\nKd 1 1 1\nmap_Kd red.png\n",
        "model/red.png": png((220, 20, 20)),
    }
    (tmp_path / "sign.zip").write_bytes(zipped(members))
    agent = make_agent(spp=4)
    path = agent.send_obj_zip(str(tmp_path / "sign.zip"))
    id = agent.spawn_object("file:" + path, (-0.5, 0.5, 2.0))
    assert agent.spawned_objects_idstr_names_table[id] == "file:" + path
    frame = agent.get_frame()
    there = frame["object"].any(axis=-1)
    # One meter wide at two meters, its origin at the lower left corner.
    assert there.sum() == pytest.approx((48 / (2 * np.tan(np.radians(30))) / 2) ** 2, rel=0.1)
    red, green, blue = frame["main"][there].mean(axis=0)
    assert red > 2 * max(green, blue)
    assert "sign" in agent.get_categories().values()
    with (tmp_path / "sign.zip").open("rb") as file:
        again = agent.send_obj_zip(file, "other.zip")
    assert again != path
    assert again.endswith("other.zip")
    with pytest.raises(ValueError, match="filename"):
        agent.send_obj_zip(io.BytesIO(b""))


def two_sided(extra=""):
    """Return an OBJ: a square at z = 0.5 of the material front, one at z = -0.5 of back, one at x = 0.8 of side."""
    squares = [(-0.5, 0.5, 0.5, "front"), (-0.5, 0.5, -0.5, "back"), (0.7, 0.9, 0.5, "side")]
    lines, faces = [extra], []
    for number, (left, right, z, material) in enumerate(squares):
        corners = [(left, -0.5), (right, -0.5), (right, 0.5), (left, 0.5)]
        lines += [f"v {x} {y} {z}" for x, y in corners]
        first = 4 * number + 1
        order = [first, first + 1, first + 2, first + 3]
        faces += [f"usemtl {material}", "f " + " ".join(f"{v}/{v - first + 1}" for v in order[:: 1 if z > 0 else -1])]
    return "\n".join([*lines, "vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1", *faces, ""])


COLORS = {
    "front": {"diffuse": [1.0, 0.0, 0.0]},
    "back": {"albedo": "blue.png"},
    "side": {"Albedo_Texture": "green.png", "metallic": 0.0, "Smoothness": 0.2},
}


def colors_by_column(frame):
    """Return the strongest channel of each column that shows the object: "r", "g" or "b"."""
    there = frame["object"].any(axis=-1)
    columns = [column for column in range(there.shape[1]) if there[:, column].any()]
    means = [frame["main"][there[:, column], column].mean(axis=0) for column in columns]
    return "".join("rgb"[int(np.argmax(mean))] for mean in means)


def test_uploaded_model_shows_its_front_from_positive_z_with_materials_of_its_json(make_agent):
    """As in Unity: coordinates are those of the left-handed space, so that +x is to the left of a camera at +z."""
    members = {
        "sign/sign.obj": two_sided(),
        "sign/sign_mat_def.json": json.dumps(COLORS),
        "sign/blue.png": png((0, 0, 255)),
        "sign/green.png": png((0, 255, 0)),
    }
    agent = make_agent(at=(0, 0, 3), width=48, height=36, flow_frame_active=False, strict=True)
    agent.set_rotation((0, 180, 0))
    path = agent.send_obj_zip(io.BytesIO(zipped(members)), "sign.zip")
    agent.spawn_object("file:" + path)
    seen = colors_by_column(agent.get_frame())
    assert re.fullmatch("g+r+", seen)
    agent.set_position((0, 0, -3))
    agent.set_rotation((0, 0, 0))
    assert re.fullmatch("b+g+", colors_by_column(agent.get_frame()))


def test_ignored_parts_of_material_definitions_are_named(uploads):
    definitions = {
        "Front": {"albedo": [255, 0, 0], "shine": 3, "normal": [0, 0, 1], "metallic": "gone.png"},
        "attic": {"albedo": [0, 1, 0]},
    }
    members = {"a.obj": two_sided("mtllib gone.mtl"), "a_mat_def.json": json.dumps(definitions)}
    with pytest.warns(StageWarning) as caught:
        template = Path(uploads.template(uploads.store("a.zip", zipped(members))))
    text = " ".join(str(each.message) for each in caught)
    for part in ("front.shine", "front.normal", "gone.png", "'attic', which no face uses"):
        assert part in text
    assert "(1, 0, 0)" in template.read_text()


@pytest.mark.parametrize("content", ["{", "[]", '{"front": 3}'])
def test_damaged_material_definitions_are_errors(uploads, content):
    path = uploads.store("a.zip", zipped({"a.obj": two_sided(), "a_mat_def.json": content}))
    with pytest.raises(StageError, match=r"a_mat_def\.json"):
        uploads.template(path)


def test_smoothness_of_unity_is_the_alpha_of_the_metallic_texture(uploads):
    image = io.BytesIO()
    Image.new("RGBA", (2, 2), (255, 0, 0, 51)).save(image, "png")
    members = {
        "a.obj": two_sided(),
        "a_mat_def.json": json.dumps({"front": {"metallic": "m.png", "normal": "n.png", "emission": [1, 1, 1]}}),
        "m.png": image.getvalue(),
        "n.png": png((128, 128, 255)),
    }
    template = Path(uploads.template(uploads.store("a.zip", zipped(members))))
    values = sorted(int(np.asarray(Image.open(each)).flat[0]) for each in template.parent.glob("textures/*data*"))
    assert values == [128, 204, 255]
    assert "emissiveColor = (1, 1, 1)" in template.read_text()


def test_template_raises_for_paths_that_were_not_uploaded_and_files_without_a_model(uploads, tmp_path):
    (tmp_path / "a.obj").write_text(SQUARE)
    for path in (str(tmp_path / "a.obj"), "/etc/passwd", "", "../../a.obj"):
        with pytest.raises(MissingFile):
            uploads.template(path)
    empty = uploads.store("empty.zip", zipped({"readme.txt": "nothing"}))
    with pytest.raises(ArgumentError, match=r"contains no \.obj file"):
        uploads.template(empty)
    script = uploads.store("run.py", b"print('stored, as in SAILenv, but not usable')")
    with pytest.raises(ArgumentError, match=r"contains no \.obj file"):
        uploads.template(script)
    with pytest.raises(Exception, match="broken"):
        uploads.template(uploads.store("broken.obj", b"\xff\xfe not a model"))


@pytest.mark.parametrize(
    "name", ["../../evil.zip", "/tmp/evil.zip", "C:\\x\\evil.zip", "..", "", "a" * 500, "x\0y.zip"]
)
def test_file_names_cannot_leave_the_folder(uploads, name):
    path = Path(uploads.store(name, b"data"))
    assert path.read_bytes() == b"data"
    assert path.parent.parent == uploads.folder
    assert ".." not in path.name
    assert len(path.name) <= 100


@pytest.mark.parametrize(
    "name", ["../up.obj", "/abs.obj", "a/../../up.obj", "C:/x.obj", "..\\up.obj", "a\\..\\..\\up.obj"]
)
def test_zip_members_outside_of_the_folder_are_refused(uploads, name, tmp_path, monkeypatch):
    (tmp_path / "temporary" / "files").mkdir(parents=True)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary" / "files"))
    with pytest.raises(ArgumentError, match="outside of its folder"):
        uploads.store("slip.zip", zipped({"ok.obj": SQUARE, name: SQUARE}))
    assert [each for each in tmp_path.rglob("*") if each.is_file()] == []
    assert uploads.folder is None  # nothing was written


def test_zip_members_that_are_links_are_refused(uploads):
    member = zipfile.ZipInfo("link.obj")
    member.create_system = 3
    member.external_attr = (stat.S_IFLNK | 0o777) << 16
    with pytest.raises(ArgumentError, match="the link"):
        uploads.store("link.zip", zipped({member: "/etc/passwd"}))


def test_zip_bombs_are_refused(uploads, monkeypatch):
    monkeypatch.setattr(uploaded_models, "MAX_UNPACKED", 1 << 20)
    bomb = zipped({"big.obj": b"v 0 0 0\n" * (1 << 18)})
    assert len(bomb) < 1 << 16
    with pytest.raises(ArgumentError, match="unpacks to more than"):
        uploads.store("bomb.zip", bomb)
    # The same with a false size in its header: first the local one, then the central one.
    for signature, offset in ((b"PK\x03\x04", 22), (b"PK\x01\x02", 24)):
        at = bomb.rindex(signature) + offset
        bomb = bomb[:at] + struct.pack("<I", 10) + bomb[at + 4 :]
    with pytest.raises(ArgumentError):
        uploads.store("false_size.zip", bomb)
    monkeypatch.setattr(uploaded_models, "MAX_MEMBERS", 10)
    with pytest.raises(ArgumentError, match="11 files"):
        uploads.store("many.zip", zipped({f"{number}.txt": "" for number in range(11)}))


def test_sizes_and_number_of_uploads_are_limited(uploads, monkeypatch):
    monkeypatch.setattr(uploaded_models, "MAX_BYTES", 100)
    with pytest.raises(ArgumentError, match="101 bytes"):
        uploads.store("large.zip", b"x" * 101)
    monkeypatch.setattr(uploaded_models, "MAX_MODEL", 10)
    with pytest.raises(ArgumentError, match=r"'a\.obj' has \d+ bytes; the limit is 10"):
        uploads.template(uploads.store("a.obj", b"v 0 0 0\n" * 3))
    uploads.close()
    monkeypatch.setattr(uploaded_models, "MAX_FILES", 2)
    uploads.store("a", b""), uploads.store("b", b"")
    with pytest.raises(ArgumentError, match="environment are 2 files"):
        uploads.store("c", b"")
    uploads.close()
    monkeypatch.setattr(uploaded_models, "MAX_STORED", 3)
    uploads.store("a", b"xx")
    with pytest.raises(ArgumentError, match="and 3 bytes"):
        uploads.store("b", b"yy")


def test_same_upload_is_stored_once(uploads):
    path = uploads.store("a.zip", zipped({"a.obj": SQUARE}))
    assert uploads.store("a.zip", zipped({"a.obj": SQUARE})) == path
    assert (
        uploads.store("b.zip", zipped({"a.obj": SQUARE})) != path != uploads.store("a.zip", zipped({"b.obj": SQUARE}))
    )


def test_upload_that_cannot_be_written_is_refused_and_the_next_is_stored(uploads):
    """One member is a file and a folder, another has a name that is too long."""
    for members in ({"a": "", "a/b.obj": SQUARE}, {"x" * 300 + ".obj": SQUARE}):
        with pytest.raises(ArgumentError, match="cannot be stored"):
            uploads.store("a.zip", zipped(members))
    path = uploads.store("a.zip", zipped({"a.obj": SQUARE}))
    assert len(list(Path(path).parent.parent.iterdir())) == 1


@pytest.mark.parametrize("name", ["unpacked", "template", "+unpacked", "+template"])
def test_upload_may_have_the_name_of_a_folder(uploads, name):
    assert Path(uploads.template(uploads.store(name, zipped({"a.obj": SQUARE})))).is_file()


@pytest.mark.parametrize("cut", [10, 40, -10, -30])
def test_damaged_zip_is_refused_or_unpacked(uploads, cut):
    data = zipped({"a.obj": "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n" * 20})
    damaged = data[:cut] if cut < 0 else data[:cut] + b"\xff" * 8 + data[cut + 8 :]
    with contextlib.suppress(ArgumentError):
        path = uploads.store("damaged.zip", damaged)
        if zipfile.is_zipfile(io.BytesIO(damaged)):
            assert uploads.template(path)
        else:
            with pytest.raises(ArgumentError):
                uploads.template(path)


def test_close_deletes_all_uploads(uploads):
    path = Path(uploads.store("a.zip", zipped({"a.obj": SQUARE})))
    folder = path.parent.parent
    uploads.close()
    assert not folder.exists()
    with pytest.raises(MissingFile):
        uploads.template(str(path))
