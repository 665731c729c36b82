# SPDX-License-Identifier: Apache-2.0
"""The command line: what it writes, says and returns. Pictures come from a fake stream at the commands' seam."""

import json
import signal
import subprocess
import sys
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from tests.export.fake_stream import FakeStream
from tiscene import catalog
from tiscene.cli import main as cli
from tiscene.cli import render as render_command
from tiscene.errors import SceneNotFound, StageWarning
from tiscene.export import EXPORTERS
from tiscene.frame.buffers import BUFFERS
from tiscene.scenario.scenario import Scenario
from tiscene.scene.description import SceneDescription
from tiscene.world.lights import warn_if_dark


class FakeCommandStream(FakeStream):
    """A FakeStream with the arguments that the commands give to Stream; they are kept in `made`."""

    made: list["FakeCommandStream"] = []  # noqa: RUF012
    interrupt_at = None

    def __init__(self, source, *, width, height, buffers, seed=0, **others) -> None:
        if source == "nowhere":
            raise SceneNotFound("scene", source, ["somewhere"])
        super().__init__(buffers, width=width, height=height, seed=seed)
        self.source, self.others = source, others
        self.interrupt_at = type(self).interrupt_at
        self.made.append(self)

    @property
    def quality(self):
        return SimpleNamespace(spp=4)

    def __next__(self):
        return self[len(self.rendered)]


@pytest.fixture
def fake(monkeypatch):
    from tiscene.cli import bench, demo, render

    monkeypatch.setattr(FakeCommandStream, "made", [])
    for command in (bench, demo, render):
        monkeypatch.setattr(command, "Stream", FakeCommandStream)
    return FakeCommandStream


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


def test_render_hands_on_every_option(tmp_path, fake):
    options = ["--quality", "photo", "--spp", 64, "--camera", "Front", "--fps", 12.5, "--arch", "cpu"]
    options += ["--taxonomy", "wikidata", "--error", 0.02, "--clamp", 10, "--pixel-filter", "gaussian"]
    options += ["--max-depth", 3, "--no-denoise"]
    options += ["--shutter", "0,0.5", "--time-code", "12", "--root", ".", "--untrusted"]
    variants = ["--variant", "/Room{lighting}=evening", "--variant", "/Room{appearance}=primitives"]
    assert render("-o", tmp_path, *options, *variants) == 0
    assert fake.made[0].source == "somewhere"
    assert fake.made[0].others.pop("report") is not None
    assert fake.made[0].others == {
        "quality": "photo",
        "spp": 64,
        "max_depth": 3,
        "denoise": False,
        "error": 0.02,
        "clamp": 10.0,
        "pixel_filter": "gaussian",
        "shutter": (0.0, 0.5),
        "camera": "Front",
        "fps": 12.5,
        "arch": "cpu",
        "incremental": False,
        "time_code": 12.0,
        "taxonomy": "wikidata",
        "root": ".",
        "untrusted": True,
        "variants": {"/Room{lighting}": "evening", "/Room{appearance}": "primitives"},
    }


class DarkStream(FakeCommandStream):
    """One that says, as a Stream does, that there is nothing to see by."""

    def __init__(self, source, **others) -> None:
        super().__init__(source, **others)
        warn_if_dark(source, [SceneDescription("dark")])


def test_render_says_that_the_picture_will_be_black(tmp_path, fake, monkeypatch, capsys):
    monkeypatch.setattr(render_command, "Stream", DarkStream)
    assert render("-o", tmp_path / "seen") == 0
    out, err = capsys.readouterr()
    assert err.startswith("tiscene: warning: somewhere: there is no light, and color will be black.")
    assert err.count("\n") == 1
    assert "light" not in out


def test_render_takes_several_cameras(tmp_path, fake):
    assert render("-o", tmp_path, "--camera", "Front,Above") == 0
    assert fake.made[-1].others["camera"] == ("Front", "Above")


def test_render_is_differential_where_it_pays_or_as_it_is_told(tmp_path, fake):
    for number, options in enumerate([[], ["--frames", ":60"], ["--frames", ":60", "--no-incremental"]]):
        render("-o", tmp_path / str(number), *options)
    render("-o", tmp_path / "told", "--incremental")
    assert [stream.others["incremental"] for stream in fake.made] == [False, None, False, True]  # None: if it can be


def test_render_all_buffers_and_the_default_ones(tmp_path, fake):
    from tiscene.stream.stream import DEFAULT_BUFFERS

    render("-o", tmp_path / "all", "--buffers", "all")
    render("-o", tmp_path / "default")
    assert [stream.buffers for stream in fake.made] == [tuple(BUFFERS), DEFAULT_BUFFERS]
    assert [stream.rendered for stream in fake.made] == [[0], [0]]


def test_interrupted_render_says_how_to_go_on_and_does(tmp_path, fake, capsys, monkeypatch):
    monkeypatch.setattr(fake, "interrupt_at", 3)
    assert render("-o", tmp_path, "--frames", ":5") == 130
    told = capsys.readouterr()
    assert told.out == ""
    assert f"3 of 5 frames are in {tmp_path}" in told.err.replace("\n", "")
    monkeypatch.setattr(fake, "interrupt_at", None)
    assert render("-o", tmp_path, "--frames", ":5") == 0
    assert fake.made[1].rendered == [3, 4]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["render", "nowhere", "-o", "x"], "tiscene: no scene 'nowhere'. Did you mean 'somewhere'?"),
        (["render", "s", "-o", "x", "--buffers", "dept"], "tiscene: no buffer 'dept'. Did you mean 'depth'?"),
        (["render", "s", "-o", "x", "--format", "jpg"], "tiscene: format='jpg': must be one of cryptomatte, exr, npz"),
        (["render", "s", "-o", "x", "--format", "sailenv", "--buffers", "rgb"], "needs the buffer 'semantic'; ask for"),
        (["demo", "-o", "x", "--frames", "0"], "tiscene: --frames 0: must be at least 1"),
        (["bench", "nowhere"], "tiscene: no scene 'nowhere'. Did you mean 'somewhere'?"),
        (["bench", "--seconds", "nan"], "tiscene: --seconds nan: must be 0 or more"),
        (["show", "kitchn"], "tiscene: no scene 'kitchn'. Did you mean 'kitchen'?"),
        (["show", "gone.usda"], "tiscene: no file 'gone.usda'"),
    ],
)
def test_mistakes_are_one_message_and_status_2(tmp_path, monkeypatch, fake, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TISCENE_PATH", str(tmp_path / "shelf"))
    (tmp_path / "shelf" / "kitchen").mkdir(parents=True)
    (tmp_path / "shelf" / "kitchen" / "scene.usda").write_text("#usda 1.0\n")
    assert cli.main(arguments) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert message in told.err
    assert "Traceback" not in told.err


@pytest.mark.parametrize(
    ("text", "frames"),
    [("7", range(7, 8)), ("3:6", range(3, 6)), (":4", range(4)), ("0:10:3", range(0, 10, 3))],
)
def test_frames(text, frames):
    args = cli.parser().parse_args(["render", "s", "-o", "x", "--frames", text])
    assert list(args.frames) == list(frames)


@pytest.mark.parametrize("text", ["", "x", "5:5", "5:2", "3:", "-1:4", "1:2:3:4", "0:9:0"])
def test_frames_that_are_none(text, capsys):
    with pytest.raises(SystemExit, match="2"):
        cli.main(["render", "s", "-o", "x", f"--frames={text}"])
    assert "is not A:B" in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--buffers", "--camera"])
def test_lists_that_name_nothing(option, capsys):
    with pytest.raises(SystemExit, match="2"):
        cli.main(["render", "s", "-o", "x", option, " ,"])
    assert f"argument {option}: ' ,' names nothing" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["evening", "/Room=evening", "Room{lighting}=evening", "/Room{lighting}="])
def test_variants_that_are_none(text, capsys):
    with pytest.raises(SystemExit, match="2"):
        cli.main(["render", "s", "-o", "x", "--variant", text])
    assert "is not PRIM{SET}=NAME" in capsys.readouterr().err


def test_the_help_names_every_format_and_the_default_buffers():
    from tiscene.stream.stream import DEFAULT_BUFFERS

    text = cli.parser()._subparsers._group_actions[0].choices["render"].format_help()
    assert set(EXPORTERS) <= set(text.replace(",", " ").split())
    assert ",".join(DEFAULT_BUFFERS) in "".join(text.split())


def test_list_prints_every_name_and_file(capsys):
    assert cli.main(["list"]) == 0
    printed = capsys.readouterr().out
    files = {name: str(path) for name, path in {**catalog.scenes(), **catalog.templates()}.items()}
    for name, text in (files | {name: aov.doc for name, aov in BUFFERS.items()}).items():
        assert any(line.startswith(f"  {name} ") and line.endswith(f" {text}") for line in printed.splitlines())


KITCHEN = """#usda 1.0
(
    defaultPrim = "Kitchen"
    metersPerUnit = 1
    upAxis = "Y"
)
def Xform "Kitchen"
{
    def Cube "Stove" (prepend apiSchemas = ["SemanticsLabelsAPI:class"])
    {
        double size = 2
        token[] semantics:labels:class = ["stove"]
    }
    def Camera "Front"
    {
        double3 xformOp:translate = (0, 0.5, 4)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def SphereLight "Bulb"
    {
        float inputs:radius = 0.1
        double3 xformOp:translate = (0, 3, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
"""


def test_show_tells_what_a_scene_holds(tmp_path, capsys):
    path = tmp_path / "kitchen.usda"
    path.write_text(KITCHEN)
    assert cli.main(["show", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].endswith(str(path))
    assert lines[1] == "Size: 2.00 x 2.00 x 2.00 m (x, y, z), Y up; 12 triangles"
    assert lines[2:8] == [
        "Cameras (1):",
        "  Front: at (0.00, 0.50, 4.00), 17 degrees high",
        "Lights (1):",
        lines[5],
        "Objects (1):",
        "  stove: Stove",
    ]
    assert lines[5].startswith("  Bulb: sphere, ")
    assert lines[8:] == [f"Templates ({len(catalog.templates())}):", *(f"  {name}" for name in catalog.templates())]


def test_show_and_inspect_take_a_scenario_for_its_scene(tmp_path, capsys):
    (tmp_path / "kitchen.usda").write_text(KITCHEN)
    Scenario(str(tmp_path / "kitchen.usda")).save(tmp_path / "run.json")
    for command in ("show", "inspect"):
        assert cli.main([command, str(tmp_path / "run.json")]) == 0
        assert f"{tmp_path / 'kitchen.usda'}\n" in capsys.readouterr().out


def test_show_cuts_long_lists_short():
    from tiscene.cli.show import _objects
    from tiscene.scene.description import SceneDescription, SceneObject

    books = [SceneObject(f"Book{k}", f"/Book{k}", "book") for k in range(10)]
    (line,) = _objects(SceneDescription("shelf", objects=tuple(books)))
    assert line == "book: Book0, Book1, Book2, Book3, Book4, Book5, Book6, Book7, and 2 more"


def test_bench_prints_a_line_for_each_size_and_kind(fake, capsys):
    assert cli.main(["bench", "somewhere", "--seconds", "0"]) == 0
    head, *rows = capsys.readouterr().out.splitlines()
    assert head.split()[-1] == "frames/s"
    tried, *measured = fake.made
    assert tried.rendered == []
    assert len(rows) == len(measured) == 12
    assert [stream.rendered for stream in measured] == [[0, 1]] * 12
    assert " 640x480 " in rows[-1]


def test_demo_ends_with_the_pictures(tmp_path, fake, capsys):
    assert cli.main(["demo", "-o", str(tmp_path), "--frames", "4", "--width", "40", "--height", "30"]) == 0
    printed = capsys.readouterr().out
    with Image.open(tmp_path / "contact_sheet.png") as sheet, Image.open(tmp_path / "animation.webp") as movie:
        assert sheet.width > 1000
        assert movie.n_frames == 4
    for name in ("contact_sheet.png", "animation.webp", "scenario.json"):
        assert str(tmp_path / name) in printed
    assert json.loads((tmp_path / "scenario.json").read_text())["scene"] == "room_02"
    assert (tmp_path / "first_frame.png").exists()
    assert fake.made[0].buffers == tuple(BUFFERS)


def test_warnings_of_the_stage_are_one_line(monkeypatch, capsys):
    from tiscene.cli import list as list_command

    monkeypatch.setattr(list_command, "run", lambda args: warnings.warn("</Room/Fog> is left out", StageWarning, 2))
    assert cli.main(["list"]) == 0
    assert capsys.readouterr().err == "tiscene: warning: </Room/Fog> is left out\n"


def test_a_closed_pipe_is_no_traceback():
    command = f"{sys.executable} -m tiscene list | true; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert "Traceback" not in done.stderr
    assert done.returncode in (0, 1)


def test_version_and_no_command(capsys):
    with pytest.raises(SystemExit, match="0"):
        cli.main(["--version"])
    assert capsys.readouterr().out.startswith("tiscene 0.")
    assert cli.main([]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert "render" in told.err


def test_an_interrupt_while_modules_are_imported_counts(monkeypatch):
    """pxr's C++ would swallow it in the midst of its import."""
    done = []

    def import_module(name):
        signal.raise_signal(signal.SIGINT)
        done.append(name)

    monkeypatch.setattr(cli.importlib, "import_module", import_module)
    assert cli.main(["list"]) == 130
    assert done == ["tiscene.cli.list"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_progress_goes_to_stderr_only(capsys):
    from tiscene.cli.terminal import note, progress

    with progress("working", 3) as step:
        step(doing="still working")
    note("a line [with] brackets")
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err == "a line [with] brackets\n"  # no bar: this is no terminal


def test_a_real_scene_renders_to_the_same_bytes_twice(tmp_path):
    options = ["--frames", "3:5", "--width", "16", "--height", "12", "--spp", "1", "--buffers", "all", "--objects"]
    for folder in ("a", "b"):
        assert cli.main(["render", "object_view", *options, "--format", "exr", "-o", str(tmp_path / folder)]) == 0
    first, second = (
        {str(path.relative_to(tmp_path / folder)): path.read_bytes() for path in (tmp_path / folder).rglob("*.*")}
        for folder in ("a", "b")
    )
    assert first == second
    assert set(first) == {"000003.exr", "000004.exr", "labels/000003.json", "labels/000004.json", "tiscene.json"}
    manifest = json.loads(first["tiscene.json"])
    assert manifest["buffers"] == list(BUFFERS)
    assert "scene.usda" in manifest["layers"]
    assert manifest["scenario"]["scene"] == "object_view"
