# SPDX-License-Identifier: Apache-2.0
"""`tiscene render`: files, output and exit status. A fake stream takes the place of rendering."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from tests.cli.fake_command_stream import FakeCommandStream
from tiscene.cli import main as cli
from tiscene.cli import render as render_command
from tiscene.export import FORMATS
from tiscene.frame.buffers import BUFFERS
from tiscene.scene.description import SceneDescription
from tiscene.world.lights import warn_if_dark, with_light


def render(*arguments) -> int:
    return cli.main(["render", "somewhere", "--width", "12", "--height", "8", *map(str, arguments)])


def test_render_writes_frames_and_prints_only_the_folder(tmp_path, fake, capsys):
    folder = tmp_path / "out"
    assert render("-o", folder, "--frames", "2:5", "--buffers", "rgb,depth", "--seed", 3, "--format", "npz") == 0
    assert capsys.readouterr().out == f"{folder}\n"
    assert sorted(path.name for path in folder.iterdir()) == [
        "000002.npz",
        "000003.npz",
        "000004.npz",
        "labels",
        "tiscene.json",
    ]
    assert list(np.load(folder / "000002.npz")) == ["rgb", "depth"]
    assert fake.made[0].seed == 3


def test_render_passes_every_option_to_the_stream(tmp_path, fake):
    options = ["--quality", "photo", "--spp", 64, "--camera", "Front", "--fps", 12.5, "--arch", "cpu"]
    options += ["--taxonomy", "wikidata", "--relative-error", 0.02, "--clamp", 10, "--pixel-filter", "gaussian"]
    options += ["--max-depth", 3, "--no-denoise", "--categories", "chair,alarm clock"]
    options += ["--shutter", "0,0.5", "--time-code", "12", "--root", ".", "--untrusted"]
    variants = ["--variant", "/Room{lighting}=evening", "--variant", "/Room{appearance}=primitives"]
    assert render("-o", tmp_path, *options, *variants) == 0
    assert fake.made[0].source == "somewhere"
    assert fake.made[0].others.pop("progress") is not None
    assert fake.made[0].others == {
        "quality": "photo",
        "spp": 64,
        "max_depth": 3,
        "denoise": False,
        "relative_error": 0.02,
        "clamp": 10.0,
        "pixel_filter": "gaussian",
        "shutter": (0.0, 0.5),
        "camera": "Front",
        "fps": 12.5,
        "arch": "cpu",
        "incremental": None,
        "time_code": 12.0,
        "taxonomy": "wikidata",
        "categories": ("chair", "alarm clock"),
        "root": ".",
        "untrusted": True,
        "strict": False,
        "subdivision": None,
        "variants": {"/Room{lighting}": "evening", "/Room{appearance}": "primitives"},
    }


class DarkStream(FakeCommandStream):
    """A stream that warns, as Stream does, of a scene without light."""

    def __init__(self, source, **others) -> None:
        super().__init__(source, **others)
        warn_if_dark(source, [with_light(SceneDescription("dark"), [])])


def test_render_warns_of_a_scene_without_light_on_stderr(tmp_path, fake, monkeypatch, capsys):
    monkeypatch.setattr(render_command, "Stream", DarkStream)
    assert render("-o", tmp_path / "seen") == 0
    out, err = capsys.readouterr()
    assert err.startswith("tiscene: warning: somewhere: there is no light, so a white sky and a sun light it.")
    assert err.count("\n") == 1
    assert "light" not in out


def test_render_accepts_several_cameras(tmp_path, fake):
    assert render("-o", tmp_path, "--camera", "Front,Above") == 0
    assert fake.made[-1].others["camera"] == ("Front", "Above")


def test_render_passes_incremental_only_if_it_is_given(tmp_path, fake):
    for number, options in enumerate([[], ["--frames", ":60"], ["--incremental"], ["--no-incremental"]]):
        render("-o", tmp_path / str(number), *options)
    assert [stream.others["incremental"] for stream in fake.made] == [None, None, True, False]


def test_render_accepts_all_buffers_and_has_default_ones(tmp_path, fake):
    from tiscene.stream.stream import DEFAULT_BUFFERS

    render("-o", tmp_path / "all", "--buffers", "all")
    render("-o", tmp_path / "default")
    assert [stream.buffers for stream in fake.made] == [tuple(BUFFERS), DEFAULT_BUFFERS]
    assert [stream.rendered for stream in fake.made] == [[0], [0]]


def test_interrupted_render_is_continued_by_the_same_command(tmp_path, fake, capsys, monkeypatch):
    monkeypatch.setattr(fake, "interrupt_at", 3)
    assert render("-o", tmp_path, "--frames", ":5") == 130
    captured = capsys.readouterr()
    assert captured.out == ""
    assert f"3 of 5 frames in {tmp_path}" in captured.err.replace("\n", "")
    monkeypatch.setattr(fake, "interrupt_at", None)
    assert render("-o", tmp_path, "--frames", ":5") == 0
    assert fake.made[1].rendered == [3, 4]


@pytest.mark.parametrize(
    ("text", "frames"),
    [
        ("", [0]),
        ("--frames 7", [7]),
        ("--frames 3:6", [3, 4, 5]),
        ("--frames :4", [0, 1, 2, 3]),
        ("--frames 0:10:3", [0, 3, 6, 9]),
        ("--frames 4:1:-1", [4, 3, 2]),
        ("--count 3", [0, 1, 2]),
        ("--frames 5: --count 3", [5, 6, 7]),
        ("--frames : --count 2", [0, 1]),
        ("--frames 5::2 --count 3", [5, 7, 9]),
        ("--frames 0:100 --count 2", [0, 1]),
    ],
)
def test_render_selects_frames_as_a_slice_with_a_count(tmp_path, fake, text, frames):
    assert render("-o", tmp_path, *text.split()) == 0
    assert fake.made[0].rendered == frames


@pytest.mark.parametrize(
    ("option", "text", "message"),
    [
        *(
            ("--frames", text, "is neither A:B with 0 <= A < B")
            for text in ("", "x", "5:5", "5:2", "5::-1", "-1:4", "1:2:3:4", "0:9:0")
        ),
        *((option, " ,", f"argument {option}: ' ,' has no names") for option in ("--buffers", "--camera")),
        *(
            ("--variant", text, "is not PRIM{SET}=NAME")
            for text in ("evening", "/Room=evening", "Room{lighting}=evening", "/Room{lighting}=")
        ),
    ],
)
def test_malformed_values_are_a_usage_error(option, text, message, capsys):
    with pytest.raises(SystemExit, match="2"):
        cli.main(["render", "s", "-o", "x", f"{option}={text}"])
    first, hint = capsys.readouterr().err.splitlines()
    assert message in first
    assert hint == "`tiscene render --help` lists the arguments."


@pytest.mark.parametrize("text", ["-3:", "-3", "-3:5"])
def test_negative_frame_is_not_taken_for_an_option(text, capsys):
    with pytest.raises(SystemExit, match="2"):
        cli.main(["render", "s", "-o", "x", "--frames", text])
    assert f"argument --frames: '{text}' is neither A:B with 0 <= A < B" in capsys.readouterr().err


def test_render_writes_the_objects_that_are_asked_for(tmp_path, fake):
    assert render("-o", tmp_path, "--objects", "visible") == 0
    assert json.loads((tmp_path / "tiscene.json").read_text())["objects"] == "visible"
    with pytest.raises(SystemExit, match="2"):
        render("-o", tmp_path, "--objects", "some")


def test_help_of_render_names_every_format_and_the_default_buffers(capsys):
    from tiscene.stream.stream import DEFAULT_BUFFERS

    with pytest.raises(SystemExit, match="0"):
        cli.main(["render", "--help"])
    text = capsys.readouterr().out
    assert set(FORMATS) <= set(text.replace(",", " ").split())
    assert ",".join(DEFAULT_BUFFERS) in "".join(text.split())


def test_rendering_a_scene_twice_writes_the_same_bytes(tmp_path):
    options = "--frames 3:5 --width 16 --height 12 --spp 1 --buffers all --objects all --format exr"
    for folder in ("a", "b"):
        assert cli.main(["render", "object_view", *options.split(), "-o", str(tmp_path / folder)]) == 0
    first, second = (
        {str(path.relative_to(tmp_path / folder)): path.read_bytes() for path in (tmp_path / folder).rglob("*.*")}
        for folder in ("a", "b")
    )
    assert first == second
    assert set(first) == {"000003.exr", "000004.exr", "labels/000003.json", "labels/000004.json", "tiscene.json"}
    manifest = json.loads(first["tiscene.json"])
    assert manifest["buffers"] == list(BUFFERS)
    assert "scene.usda" in manifest["file_digests"]
    assert manifest["scenario"]["scene"] == "object_view"


class EmptyStream(FakeCommandStream):
    """A stream of an empty stage."""

    world = SimpleNamespace(descriptions=[SceneDescription("empty")])


def test_render_warns_of_a_scene_without_geometry_on_stderr(tmp_path, fake, monkeypatch, capsys):
    monkeypatch.setattr(render_command, "Stream", EmptyStream)
    assert render("-o", tmp_path / "seen") == 0
    assert capsys.readouterr().err == "tiscene: warning: somewhere: there is no geometry to render\n"
