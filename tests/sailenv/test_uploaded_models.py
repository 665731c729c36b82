# SPDX-License-Identifier: Apache-2.0
"""Models that clients send: what is taken, what is refused, and that nothing leaves its folder."""

import contextlib
import io
import stat
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tiscene.errors import ArgumentError, MissingFile
from tiscene.sailenv import uploaded_models
from tiscene.sailenv.uploaded_models import Uploads

SQUARE = (
    "mtllib s.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl red\nf 1/1 2/2 3/3 4/4\n"
)


@pytest.fixture
def world():
    world = Uploads()
    yield world
    world.close()


def zipped(members):
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return data.getvalue()


def picture(color):
    data = io.BytesIO()
    Image.new("RGB", (4, 4), color).save(data, "png")
    return data.getvalue()


def test_a_model_with_its_texture_becomes_a_thing_to_spawn(make_agent, tmp_path):
    members = {
        "thing/sign.obj": SQUARE,
        "thing/s.mtl": "newmtl red\nKd 1 1 1\nmap_Kd red.png\n",
        "thing/red.png": picture((220, 20, 20)),
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


def test_what_was_not_sent_cannot_be_spawned(world, tmp_path):
    (tmp_path / "a.obj").write_text(SQUARE)
    for path in (str(tmp_path / "a.obj"), "/etc/passwd", "", "../../a.obj"):
        with pytest.raises(MissingFile):
            world.template(path)
    empty = world.store("empty.zip", zipped({"readme.txt": "nothing"}))
    with pytest.raises(ArgumentError, match=r"holds no \.obj file"):
        world.template(empty)
    script = world.store("run.py", b"print('kept, as SAILenv did, and of no use')")
    with pytest.raises(ArgumentError, match=r"holds no \.obj file"):
        world.template(script)
    with pytest.raises(Exception, match="broken"):
        world.template(world.store("broken.obj", b"\xff\xfe nothing that is a model"))


@pytest.mark.parametrize(
    "name", ["../../evil.zip", "/tmp/evil.zip", "C:\\x\\evil.zip", "..", "", "a" * 500, "x\0y.zip"]
)
def test_names_stay_in_the_folder(world, name):
    path = Path(world.store(name, b"data"))
    assert path.read_bytes() == b"data"
    assert path.parent.parent == world._folder
    assert ".." not in path.name
    assert len(path.name) <= 100


@pytest.mark.parametrize(
    "name", ["../up.obj", "/abs.obj", "a/../../up.obj", "C:/x.obj", "..\\up.obj", "a\\..\\..\\up.obj"]
)
def test_zips_that_lead_outside_are_refused(world, name):
    before = set(Path("/tmp").rglob("up.obj"))
    with pytest.raises(ArgumentError, match="outside of its folder"):
        world.store("slip.zip", zipped({"ok.obj": SQUARE, name: SQUARE}))
    assert set(Path("/tmp").rglob("up.obj")) == before
    assert world._folder is None  # nothing was written


def test_links_are_refused(world):
    member = zipfile.ZipInfo("link.obj")
    member.create_system = 3
    member.external_attr = (stat.S_IFLNK | 0o777) << 16
    with pytest.raises(ArgumentError, match="the link"):
        world.store("link.zip", zipped({member: "/etc/passwd"}))


def test_bombs_are_refused(world, monkeypatch):
    monkeypatch.setattr(uploaded_models, "MAX_UNPACKED", 1 << 20)
    bomb = zipped({"big.obj": b"v 0 0 0\n" * (1 << 18)})
    assert len(bomb) < 1 << 16
    with pytest.raises(ArgumentError, match="bytes unpacked"):
        world.store("bomb.zip", bomb)
    # The same, with a header that says otherwise: first the local one, then the central one.
    for signature, offset in ((b"PK\x03\x04", 22), (b"PK\x01\x02", 24)):
        at = bomb.rindex(signature) + offset
        bomb = bomb[:at] + struct.pack("<I", 10) + bomb[at + 4 :]
    with pytest.raises(ArgumentError):
        world.store("liar.zip", bomb)
    monkeypatch.setattr(uploaded_models, "MAX_MEMBERS", 10)
    with pytest.raises(ArgumentError, match="11 files"):
        world.store("many.zip", zipped({f"{number}.txt": "" for number in range(11)}))


def test_sizes_and_numbers_are_bounded(world, monkeypatch):
    monkeypatch.setattr(uploaded_models, "MAX_BYTES", 100)
    with pytest.raises(ArgumentError, match="101 bytes"):
        world.store("large.zip", b"x" * 101)
    monkeypatch.setattr(uploaded_models, "MAX_MODEL", 10)
    with pytest.raises(ArgumentError, match=r"'a\.obj' has \d+ bytes; at most 10"):
        world.template(world.store("a.obj", b"v 0 0 0\n" * 3))
    world.close()
    monkeypatch.setattr(uploaded_models, "MAX_FILES", 2)
    world.store("a", b""), world.store("b", b"")
    with pytest.raises(ArgumentError, match="at most 2 files"):
        world.store("c", b"")
    world.close()
    monkeypatch.setattr(uploaded_models, "MAX_STORED", 3)
    world.store("a", b"xx")
    with pytest.raises(ArgumentError, match="3 bytes are kept in a world"):
        world.store("b", b"yy")


def test_what_is_sent_again_is_kept_once(world):
    path = world.store("a.zip", zipped({"a.obj": SQUARE}))
    assert world.store("a.zip", zipped({"a.obj": SQUARE})) == path
    assert world.store("b.zip", zipped({"a.obj": SQUARE})) != path != world.store("a.zip", zipped({"b.obj": SQUARE}))


def test_what_cannot_be_kept_is_nobody_elses_business(world):
    """A file that is a folder too, a name too long for any disk: refused, and the next one is kept."""
    for members in ({"a": "", "a/b.obj": SQUARE}, {"x" * 300 + ".obj": SQUARE}):
        with pytest.raises(ArgumentError, match="cannot be kept"):
            world.store("a.zip", zipped(members))
    path = world.store("a.zip", zipped({"a.obj": SQUARE}))
    assert len(list(Path(path).parent.parent.iterdir())) == 1


@pytest.mark.parametrize("cut", [10, 40, -10, -30])
def test_damaged_zips_are_no_trap(world, cut):
    data = zipped({"a.obj": "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n" * 20})
    damaged = data[:cut] if cut < 0 else data[:cut] + b"\xff" * 8 + data[cut + 8 :]
    with contextlib.suppress(ArgumentError):
        path = world.store("damaged.zip", damaged)
        if zipfile.is_zipfile(io.BytesIO(damaged)):
            assert world.template(path)
        else:
            with pytest.raises(ArgumentError):
                world.template(path)


def test_everything_goes_when_the_world_ends(world):
    path = Path(world.store("a.zip", zipped({"a.obj": SQUARE})))
    folder = path.parent.parent
    world.close()
    assert not folder.exists()
    with pytest.raises(MissingFile):
        world.template(str(path))
