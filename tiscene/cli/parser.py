# SPDX-License-Identifier: Apache-2.0
"""Command-line arguments of all commands.

`parser` builds the argparse parser. Values that only a command can check, such as names of scenes, are checked there.
"""

from __future__ import annotations

import argparse
import re
from typing import Any, NoReturn

import tiscene
from tiscene.cli.argument_types import frame_slice, name_list, path
from tiscene.cli.common_arguments import (
    Commands,
    add_arch,
    add_fps,
    add_output,
    add_quality,
    add_reading,
    add_seed,
    add_shown_stream,
    add_size,
    add_source,
    add_spp,
    add_variant,
)
from tiscene.cli.data_set_arguments import add_generate, add_merge, add_sample, add_verify
from tiscene.cli.join_arguments import add_join
from tiscene.cli.render_arguments import add_render
from tiscene.errors import did_you_mean


class _Parser(argparse.ArgumentParser):
    """Reports errors in two lines; the usage of a command has up to twelve more. Its commands do so too.

    Unknown arguments are reported by the command that they were given to, and as unknown commands with the nearest one.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._negative_number_matcher = re.compile(r"-\.?\d")  # values, such as "-3:", as from Python 3.14 on

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        known, unknown = super().parse_known_args(args, namespace)
        if unknown:
            nearest = did_you_mean(unknown[0].partition("=")[0], self._option_string_actions)
            self.error(f"unrecognized arguments: {' '.join(unknown)}{nearest}")
        return known, unknown

    def error(self, message: str) -> NoReturn:
        unknown = re.match(r"argument (COMMAND|ACTION): invalid choice: '(.*?)' \(choose from (.*)\)", message)
        if unknown:
            kind, name, choices = unknown.groups()
            message = f"no {kind.lower()} {name!r}{did_you_mean(name, re.findall(r'[a-z]+', choices))}"
        self.exit(2, f"{self.prog}: error: {message}\n`{self.prog} --help` lists the arguments.\n")


def parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    top: argparse.ArgumentParser = _Parser(
        prog="tiscene",
        description="Endless, exactly repeatable streams of path-traced, labeled frames from USD scenes.",
    )
    top.add_argument("--version", action="version", version=f"tiscene {tiscene.__version__}")
    commands = top.add_subparsers(title="commands", dest="command", metavar="COMMAND")
    for add in (
        _demo,
        add_render,
        add_verify,
        add_merge,
        add_sample,
        add_generate,
        _preview,
        _view,
        _list,
        _show,
        _inspect,
        _import,
        add_join,
        _bench,
        _measure,
        _evaluate,
        _serve,
        _sailenv,
    ):
        add(commands)
    return top


def _demo(commands: Commands) -> None:
    demo = commands.add_parser("demo", help="render a short scenario with every buffer")
    add_output(demo, "tiscene-demo")
    demo.add_argument(
        "--frames", metavar="N", type=int, default=24, help="length of the animation (default: %(default)s)"
    )
    add_size(demo, width=320, height=240)
    add_quality(demo, "standard")
    add_arch(demo)


def _preview(commands: Commands) -> None:
    preview = commands.add_parser(
        "preview",
        help="write frames as one HTML page that plays them, with the values under the cursor",
        description="Write one page that any browser opens from disk: a player with all buffers, the values under the "
        "cursor, a table of objects, and trajectories seen from above.",
    )
    preview.add_argument(
        "-o", "--output", metavar="FILE", type=path, required=True, help="page to write, such as preview.html"
    )
    add_shown_stream(preview)


def _view(commands: Commands) -> None:
    view = commands.add_parser(
        "view", help="show frames in Rerun while they are rendered (needs pip install 'tiscene[rerun]')"
    )
    view.add_argument("--save", metavar="FILE", type=path, help="write a file for Rerun instead, such as run.rrd")
    view.add_argument("--connect", metavar="URL", help="send frames to a viewer that runs already")
    add_shown_stream(view)


def _list(commands: Commands) -> None:
    listing = commands.add_parser("list", help="list scenes, object templates and buffers")
    listing.add_argument("--json", action="store_true", help="print JSON, with the ids of categories")


def _show(commands: Commands) -> None:
    show = commands.add_parser("show", help="show the size, cameras, lights, objects and templates of a scene")
    show.add_argument("scene", metavar="SCENE", help="the name of a scene, a USD file, or a scenario (.json)")
    show.add_argument("--paths", action="store_true", help="name cameras, lights and all objects by their prim paths")
    add_variant(show)


def _inspect(commands: Commands) -> None:
    inspect = commands.add_parser(
        "inspect", help="report the contents of a USD file, which of them are rendered, and which are not and why"
    )
    inspect.add_argument(
        "file", metavar="FILE", type=path, help="a USD file, the name of a scene, or a scenario (.json)"
    )
    inspect.add_argument("--json", action="store_true", help="print the report as JSON")
    add_reading(inspect)


def _import(commands: Commands) -> None:
    importer = commands.add_parser(
        "import",
        help="make a template of a model (OBJ, glTF, PLY, STL, USD) or of each model of a furniture catalog (.sh3f)",
        description="Make a template of a model file. Its license files are kept in the template's metadata.",
    )
    importer.add_argument("file", metavar="FILE", type=path, help="the model, or a Sweet Home 3D furniture catalog")
    importer.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=path,
        help="library (default: the first folder of TISCENE_PATH, else tiscene-assets)",
    )
    importer.add_argument(
        "--name", metavar="TEXT", default="", help="name, such as 'Chair 03' (default: from the file name)"
    )
    importer.add_argument("--overwrite", action="store_true", help="replace a template of the same name")
    importer.add_argument("--label", metavar="TEXT", default="", help="semantic class, such as chair")
    importer.add_argument(
        "--unit", metavar="M", type=float, help="meters per unit of the file (default: by the format)"
    )
    importer.add_argument("--up", choices=("Y", "Z"), help="up axis of the file (default: by the format)")
    importer.add_argument(
        "--keep-origin", action="store_true", help="do not move the origin to the center of the bounding box"
    )
    importer.add_argument("--author", metavar="TEXT", default="", help="author of the model")
    importer.add_argument(
        "--license", metavar="TEXT", default="", help="license text or file (default: the license files beside it)"
    )


def _bench(commands: Commands) -> None:
    bench = commands.add_parser(
        "bench",
        help="measure frames per second on this machine",
        description="Measure frames per second of several buffers, presets and sizes; this takes some minutes.",
    )
    bench.add_argument(
        "scene", metavar="SCENE", nargs="?", help="the name of a scene or a USD file (default: the demo's)"
    )
    bench.add_argument(
        "--seconds", metavar="S", type=float, default=3.0, help="duration of each measurement (default: %(default)g)"
    )
    add_arch(bench)


def _measure(commands: Commands) -> None:
    measure = commands.add_parser(
        "measure",
        help="measure how hard the frames of a scene or scenario are",
        description="Print measures of difficulty (visible instances, size, motion, novelty of views and others), and "
        "write them for each frame, with a plot, into a folder. See docs/difficulty.md.",
    )
    add_source(measure)
    add_output(measure, "tiscene-measure-NAME of the source")
    measure.add_argument(
        "--frames",
        metavar="A:B[:STEP]",
        type=frame_slice,
        default=slice(0, 250, 5),
        help="frames as a Python slice (default: 0:250:5)",
    )
    add_size(measure, width=128, height=96)
    add_fps(measure)
    measure.add_argument("--contrast", action="store_true", help="render color too, to measure contrast; slower")
    measure.add_argument(
        "--quality", metavar="NAME", default="fast", help="preset of colors for --contrast (default: %(default)s)"
    )
    add_arch(measure)


def _evaluate(commands: Commands) -> None:
    evaluate = commands.add_parser(
        "evaluate",
        help="evaluate continual learners on a course of phases",
        description="Evaluate learners on a benchmark suite or on a course of your own, and write scores (JSON) and a "
        "page (index.html) into a folder. See docs/learning.md.",
    )
    evaluate.add_argument(
        "course",
        metavar="COURSE",
        help="a suite (solids, room, home; solids-hard for another grade), a course (.json), or with --verify a score",
    )
    evaluate.add_argument(
        "--learner",
        metavar="NAME",
        action="append",
        help="naive, replay, ewc, si, lwf, shuffled, ncm, flow, blind, all, or module:Class; may be repeated "
        "(default: naive)",
    )
    evaluate.add_argument(
        "--seeds", metavar="N", type=int, default=1, help="evaluate each learner with seeds 0 to N - 1 (default: 1)"
    )
    add_output(evaluate, "tiscene-evaluation-COURSE")
    evaluate.add_argument(
        "--cost",
        metavar="FRAMES",
        type=float,
        default=0.0,
        help="frames that pass while a learner learns from one; it misses them (default: 0, the stream waits)",
    )
    evaluate.add_argument(
        "--checkpoint", action="store_true", help="save the state every 30 s; the same command continues from it"
    )
    evaluate.add_argument("--verify", action="store_true", help="COURSE is a saved score: compute it again and compare")


def _serve(commands: Commands) -> None:
    serve = commands.add_parser(
        "serve",
        help="serve unmodified SAILenv clients",
        description="Serve worlds to SAILenv clients (see docs/sailenv.md). Ctrl-C or SIGTERM stops it cleanly.",
    )
    serve.add_argument("scene", metavar="SCENE", nargs="?", help="first scene (default: SAILenv's)")
    serve.add_argument(
        "--host",
        metavar="ADDRESS",
        default="127.0.0.1",
        help="address to listen on (default: %(default)s, this machine alone)",
    )
    serve.add_argument(
        "--port", metavar="N", type=int, default=8085, help="port; 0: any free one (default: %(default)s)"
    )
    _add_sailenv_world(serve)
    serve.add_argument(
        "--consecutive-flow",
        action="store_true",
        help="flow is always that from the frame before (default: from the client's last frame)",
    )
    serve.add_argument(
        "--keep-clock",
        action="store_true",
        help="the frame clock continues when a client changes the scene (default: it starts again, as in SAILenv)",
    )
    serve.add_argument(
        "--together",
        action="store_true",
        help="when a client changes the scene, all go along, as in SAILenv (default: the others stay)",
    )
    serve.add_argument(
        "--world",
        metavar="SCENE",
        help="a scene with rooms, such as home_01: changing to a scene that is one of its rooms is a walk there",
    )
    serve.add_argument(
        "--query-budget",
        type=int,
        metavar="N",
        help="how many pixels each client may ask about, an extension of the protocol (default: any number)",
    )
    serve.add_argument(
        "--wait",
        type=float,
        default=1.0,
        metavar="S",
        help="how long the clock waits for a slow client (default: %(default)g)",
    )
    serve.add_argument("-v", "--verbose", action="count", default=0, help="log each event; -vv: each frame too")


def _sailenv(commands: Commands) -> None:
    sailenv = commands.add_parser("sailenv", help="record what SAILenv scripts and scenarios show")
    actions = sailenv.add_subparsers(title="actions", dest="action", metavar="ACTION", required=True)
    record = actions.add_parser(
        "record",
        help="run a script or play a scenario, and record the frames in the layout of SAILenv's recordings",
        description="Run a script, or play a scenario (.json), and record each frame that its first agent receives: "
        "color, flow, a class for each pixel, and a focus of attention (see docs/sailenv.md). Arguments of the script "
        "come last, after --.",
    )
    record.add_argument(
        "source", metavar="SCRIPT_OR_SCENARIO", type=path, help="a Python file that imports sailenv, or JSON"
    )
    add_output(record)
    record.add_argument("--frames", metavar="N", type=int, help="end after N frames (default: when the script ends)")
    record.add_argument(
        "--classes",
        metavar="NAME,...",
        type=name_list,
        help="categories that become the classes 0, 1, ...; everything else is the last class, the background "
        "(default: all categories)",
    )
    record.add_argument(
        "--focus", action=argparse.BooleanOptionalAction, default=True, help="write focus.foa (default: yes)"
    )
    record.add_argument("--overwrite", action="store_true", help="delete an earlier recording in the folder")
    record.add_argument("--windows", action="store_true", help="let the script open windows and wait for keys")
    record.add_argument("--scene", metavar="SCENE", help="first scene (default: SAILenv's)")
    record.add_argument("--width", metavar="PX", type=int, help="image width for a scenario (default: 256)")
    record.add_argument("--height", metavar="PX", type=int, help="image height for a scenario (default: 192)")
    _add_sailenv_world(record)


def _add_sailenv_world(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the worlds of SAILenv's agents."""
    command.add_argument(
        "--fps", metavar="N", type=float, default=25.0, help="frames per second (default: %(default)g)"
    )
    add_quality(command, "preview")
    add_spp(command)
    command.add_argument(
        "--incremental",
        action=argparse.BooleanOptionalAction,
        help="frames of a camera that stands still do not flicker; their first one waits for a base image or a "
        "panorama (default: by --quality)",
    )
    add_seed(command)
    command.add_argument(
        "--physics", action="store_true", default=None, help="objects fall and are pushed (extra: physics)"
    )
    add_arch(command)
