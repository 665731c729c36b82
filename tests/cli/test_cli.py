# SPDX-License-Identifier: Apache-2.0
"""The command line: files, output and exit status. A fake stream takes the place of rendering."""

import json
import os
import signal
import subprocess
import sys
import warnings

import pytest
from PIL import Image

from tests.usd.helpers import write
from tiscene import catalog
from tiscene.cli import main as cli
from tiscene.errors import StageWarning
from tiscene.frame.buffers import BUFFERS
from tiscene.scenario.objects import Object
from tiscene.scenario.scenario import Scenario
from tiscene.scene.description import SceneDescription
from tiscene.usd.read.stage_reader import read_stage


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["render", "nowhere", "-o", "x"], "tiscene: no scene 'nowhere'. Did you mean 'somewhere'?"),
        (["render", "s", "-o", "x", "--buffers", "dept"], "tiscene: no buffer 'dept'. Did you mean 'depth'?"),
        (["render", "s", "-o", "x", "--format", "jpg"], "tiscene: format='jpg': must be one of png, exr, exr-single"),
        (
            ["render", "s", "-o", "x", "--format", "sailenv", "--buffers", "rgb"],
            "requires the buffer 'semantic', 'backward_flow': make the stream with buffers=(",
        ),
        (["render", "s", "-o", "x", "--frames", "5:"], "--frames 5: has no end, and neither has a stream: give an end"),
        (["render", "s", "-o", "x", "--count", "0"], "tiscene: --count 0: must be at least 1"),
        (["demo", "-o", "x", "--frames", "0"], "tiscene: --frames 0: must be at least 1"),
        (["bench", "nowhere"], "tiscene: no scene 'nowhere'. Did you mean 'somewhere'?"),
        (["bench", "--seconds", "nan"], "tiscene: --seconds nan: must be 0 or more"),
        (["show", "kitchn"], "tiscene: no scene 'kitchn'. Did you mean 'kitchen'?"),
        (["show", "gone.usda"], "tiscene: no file 'gone.usda'"),
    ],
)
def test_user_errors_are_one_message_and_status_2(tmp_path, monkeypatch, fake, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TISCENE_PATH", str(tmp_path / "shelf"))
    (tmp_path / "shelf" / "kitchen").mkdir(parents=True)
    (tmp_path / "shelf" / "kitchen" / "scene.usda").write_text("#usda 1.0\n")
    assert cli.main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert message in captured.err
    assert "Traceback" not in captured.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["rendr", "room_02", "-o", "x"],
            "error: no command 'rendr'; did you mean 'render'?\n`tiscene --help`",
        ),
        (["sailenv", "recrod"], "no action 'recrod'; did you mean 'record'?\n`tiscene sailenv --help`"),
        (["list", "--jsn"], "tiscene list: error: unrecognized arguments: --jsn; did you mean '--json'?"),
        (["render", "s", "-o", "x", "--zzz=1"], "unrecognized arguments: --zzz=1\n`tiscene render --help`"),
    ],
)
def test_misspelt_commands_and_arguments_have_suggestions(capsys, arguments, message):
    """Unknown arguments were reported with `tiscene --help`, which does not list them."""
    with pytest.raises(SystemExit) as caught:
        cli.main(arguments)
    assert caught.value.code == 2
    assert message in capsys.readouterr().err


def test_list_prints_every_name_and_file(capsys):
    assert cli.main(["list"]) == 0
    printed = capsys.readouterr().out
    files = {name: str(entry.path) for name, entry in {**catalog.scenes(), **catalog.templates()}.items()}
    for name, text in (files | {name: buffer.doc for name, buffer in BUFFERS.items()}).items():
        assert any(line.startswith(f"  {name} ") and line.endswith(f" {text}") for line in printed.splitlines())


def test_list_json_has_scenes_templates_categories_and_buffers(capsys, tmp_path, monkeypatch):
    damaged = tmp_path / "templates" / "damaged" / "template.usda"
    damaged.parent.mkdir(parents=True)
    damaged.write_text("#usda 1.0\n{")
    monkeypatch.setenv("TISCENE_PATH", str(tmp_path))
    assert cli.main(["list", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert {row["name"]: row["path"] for row in content["scenes"]} == {
        name: str(scene.path) for name, scene in catalog.scenes().items()
    }
    assert {row["name"]: row["category"] for row in content["templates"]} == {
        name: None if name == "Damaged" else template.category for name, template in catalog.templates().items()
    }
    assert {row["name"]: row["id"] for row in content["categories"]} == catalog.categories()
    assert {row["name"]: row["dtype"] for row in content["buffers"]} == {
        name: buffer.dtype for name, buffer in BUFFERS.items()
    }


KITCHEN = """
def Xform "Kitchen" {
    def Cube "Stove" (prepend apiSchemas = ["SemanticsLabelsAPI:class"]) {
        double size = 2
        token[] semantics:labels:class = ["stove"]
    }
    def Camera "Front" {
        double3 xformOp:translate = (0, 0.5, 4)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def SphereLight "Bulb" {
        float inputs:radius = 0.1
        double3 xformOp:translate = (0, 3, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
"""

_VARIANTS = "".join(f'"{name}" {{\n    def Cube "{name}" {{}}\n}}\n' for name in ("near", "far"))
TWO_VARIANTS = (
    'def Xform "Room" (variants = {\nstring place = "near"\n}\nprepend variantSets = "place")\n'
    f'{{\nvariantSet "place" = {{\n{_VARIANTS}}}\n}}\n'
)


@pytest.fixture
def kitchen(tmp_path):
    return str(write(tmp_path, KITCHEN, name="kitchen.usda"))


def test_show_prints_the_contents_of_a_scene(kitchen, capsys):
    assert cli.main(["show", kitchen]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].endswith(kitchen)
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
    assert lines[8] == f"Templates ({len(catalog.templates())}):"
    assert " ".join(line.strip() for line in lines[9:]) == ", ".join(catalog.templates())
    assert max(map(len, lines[9:])) <= 102


@pytest.mark.parametrize("saved", [False, True])
def test_show_selects_variants_given_or_of_a_scenario(tmp_path, capsys, saved):
    path = str(write(tmp_path, TWO_VARIANTS))
    Scenario(path, variants={"/Room{place}": "far"}).save(tmp_path / "run.json")
    assert (
        cli.main(["show", *([str(tmp_path / "run.json")] if saved else [path, "--variant", "/Room{place}=far"])]) == 0
    )
    out = capsys.readouterr().out
    assert "far" in out
    assert "near" not in out


def test_show_and_inspect_of_a_scenario_are_of_its_scene(tmp_path, kitchen, capsys):
    Scenario(kitchen).save(tmp_path / "run.json")
    for command in ("show", "inspect"):
        assert cli.main([command, str(tmp_path / "run.json")]) == 0
        assert f"{kitchen}\n" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("template", "message"), [("Char 01", "no template 'Char 01'"), ("/Kitchen/Stve", "/Kitchen/Stve")]
)
def test_show_reports_what_a_scenario_places_and_there_is_not(tmp_path, kitchen, capsys, template, message):
    Scenario(kitchen, [Object("a", template)]).save(tmp_path / "run.json")
    assert cli.main(["show", str(tmp_path / "run.json")]) != 0
    assert message in capsys.readouterr().err


def test_show_names_everything_by_its_prim_path(kitchen, capsys):
    assert cli.main(["show", kitchen, "--paths"]) == 0
    stage = read_stage(kitchen)
    lines = capsys.readouterr().out.splitlines()
    assert lines[3].startswith(f"  {next(iter(stage.camera_names))}: at")
    assert lines[5].startswith(f"  {stage.lights[0].prim_path}: sphere, ")
    assert lines[7] == f"  {stage.objects[0].prim_path}: Stove, stove"


def test_show_shortens_long_lists():
    from tiscene.cli.show import object_lines
    from tiscene.scene.description import SceneObject

    books = [SceneObject(f"Book{k}", f"/Book{k}", "book") for k in range(10)]
    (line,) = object_lines(SceneDescription("shelf", objects=tuple(books)))
    assert line == "book: Book0, Book1, Book2, Book3, Book4, Book5, Book6, Book7, and 2 more"


def test_bench_prints_a_line_for_each_size_and_kind(fake, capsys):
    assert cli.main(["bench", "somewhere", "--seconds", "0"]) == 0
    printed = capsys.readouterr()
    assert printed.err.startswith("somewhere, cuda, ")
    head, *rows = printed.out.splitlines()
    assert head.split()[-1] == "frames/s"
    tried, *measured = fake.made
    assert tried.rendered == []
    assert len(rows) == len(measured) == 12
    assert [stream.rendered for stream in measured] == [[0, 1]] * 12
    assert " 640x480 " in rows[-1]


def test_demo_writes_its_images_and_prints_their_paths(tmp_path, fake, capsys):
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


def test_stage_warning_is_one_line_on_stderr_once_a_command(monkeypatch, capsys):
    from tiscene.cli import list as list_command

    def warn_twice(args):
        for _ in range(2):
            warnings.warn("</Room/Fog> is left out", StageWarning, 2)

    monkeypatch.setattr(list_command, "run", warn_twice)
    for _ in range(2):
        assert cli.main(["list"]) == 0
        assert capsys.readouterr().err == "tiscene: warning: </Room/Fog> is left out\n"


def test_closed_pipe_prints_no_traceback():
    command = f"{sys.executable} -m tiscene list | true; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert "Traceback" not in done.stderr
    assert done.returncode in (0, 1)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is always full")
def test_full_device_is_reported_in_one_line():
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "tiscene", "list"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.stderr == "tiscene: the output cannot be written: no space left on its device\n"
    assert done.returncode == 2


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        (["render", "s", "-o", ""], "-o/--output"),
        (["demo", "-o", ""], "-o/--output"),
        (["generate", "", "-n", "1", "-o", "x"], "RECIPE"),
        (["verify", ""], "DIR"),
        (["merge", "x", "x/a", ""], "PART"),
        (["evaluate", "solids", "-o", ""], "-o/--output"),
        (["sailenv", "record", "x.py", "-o", ""], "-o/--output"),
    ],
)
def test_empty_path_is_refused(capsys, arguments, name):
    """It would stand for the present folder, where a script's variable is not set."""
    with pytest.raises(SystemExit, match="2"):
        cli.main(arguments)
    assert f"error: argument {name}: the path is empty" in capsys.readouterr().err


def test_command_without_standard_output_succeeds():
    done = subprocess.run(
        ["bash", "-c", f"{sys.executable} -m tiscene list >&-"], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_version_option_and_missing_command(capsys):
    with pytest.raises(SystemExit, match="0"):
        cli.main(["--version"])
    assert capsys.readouterr().out.startswith("tiscene 0.")
    assert cli.main([]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "render" in captured.err


def test_interrupt_during_imports_ends_the_command_at_once():
    program = """
import importlib, signal, sys
from tiscene.cli.main import main
def slow(name):
    try:
        signal.raise_signal(signal.SIGINT)
    except BaseException:  # as pxr's C++ code does
        pass
    print("imported")
importlib.import_module = slow
sys.argv = ["tiscene", "list"]
sys.exit(main())
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "tiscene: interrupted\n")


def test_interrupt_during_imports_takes_effect_after_them(monkeypatch):
    """The C++ code of pxr would swallow an interrupt during its import."""
    imported = []

    def import_module(name):
        signal.raise_signal(signal.SIGINT)
        imported.append(name)

    monkeypatch.setattr(cli.importlib, "import_module", import_module)
    assert cli.main(["list"]) == 130
    assert imported == ["tiscene.cli.list"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_progress_and_notes_go_to_stderr(capsys):
    from tiscene.cli.terminal import note, progress

    with progress("working", 3) as step:
        step(task="still working")
    note("a line [with] brackets")
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == "a line [with] brackets\n"  # no progress bar outside of a terminal


STAGE = """#usda 1.0
( metersPerUnit = 1 )
def Xform "Pièce" {
    def Cube "Matière" {}
}
"""


def test_stages_with_accents_are_read_without_utf_8_and_names_of_files_are_refused(tmp_path):
    """As in containers without a locale; Python itself uses UTF-8 there, unless PYTHONUTF8=0 says otherwise."""
    (tmp_path / "room.usda").write_text(STAGE, "utf-8")
    (tmp_path / "pièce.usda").write_text(STAGE, "utf-8")
    recipe = {"scenes": ["room.usda"], "splits": {"entraîné": 1}}
    (tmp_path / "recipe.json").write_text(json.dumps(recipe), "ascii")
    environment = {**os.environ, "PYTHONUTF8": "0", "LC_ALL": "C"}

    def run(*arguments):
        command = [sys.executable, "-m", "tiscene", *arguments]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, check=False)
        return done.returncode, done.stdout.decode("ascii"), done.stderr.decode("ascii")

    status, out, err = run("show", "room.usda", "--paths")
    assert (status, "/Pi?ce/Mati?re" in out) == (0, True), err
    advice = "is not text in the encoding ascii: set the environment variable PYTHONUTF8=1, or LC_ALL=C.UTF-8\n"
    for arguments in (("inspect", "pièce.usda"), ("sample", "recipe.json", "-n", "1", "-o", "out")):
        status, _, err = run(*arguments)
        assert (status, err.endswith(advice), len(err.splitlines())) == (2, True, 1), err
