# SPDX-License-Identifier: Apache-2.0
"""Command-line arguments of all commands.

`parser` builds the argparse parser. Values that only a command can check, such as names of scenes, are checked there.
"""

from __future__ import annotations

import argparse
from typing import TypeAlias

import tiscene
from tiscene.cli.argument_types import frame_slice, name_list, number_list, variant_choice
from tiscene.cli.data_set_arguments import add_merge, add_parts, add_verify
from tiscene.cli.measure_arguments import add_measure
from tiscene.export.formats import FORMATS

Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"


def parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    top = argparse.ArgumentParser(
        prog="tiscene",
        description="Endless, exactly repeatable streams of path-traced, labeled frames from USD scenes.",
    )
    top.add_argument("--version", action="version", version=f"tiscene {tiscene.__version__}")
    commands = top.add_subparsers(title="commands", dest="command", metavar="COMMAND")
    for add in (
        _demo,
        _render,
        add_verify,
        add_merge,
        _preview,
        _view,
        _list,
        _show,
        _inspect,
        _import,
        _bench,
        add_measure,
        _evaluate,
        _serve,
        _sailenv,
    ):
        add(commands)
    return top


def _demo(commands: Commands) -> None:
    demo = commands.add_parser("demo", help="render a short scenario with every buffer")
    demo.add_argument(
        "-o", "--output", metavar="DIR", default="tiscene-demo", help="folder to write (default: %(default)s)"
    )
    demo.add_argument(
        "--frames", metavar="N", type=int, default=24, help="length of the animation (default: %(default)s)"
    )
    _add_size(demo, width=320, height=240)
    _add_quality(demo, "standard")
    _add_arch(demo)


def _render(commands: Commands) -> None:
    render = commands.add_parser(
        "render",
        help="write frames of a scene or scenario into a folder",
        description="Write frames into a folder, with a manifest (tiscene.json). The same command continues after an "
        "interruption: frames whose files are there are not rendered again. One command at a time may write into a "
        "folder.",
    )
    render.add_argument(
        "source", metavar="SCENE_OR_SCENARIO", help="the name of a scene, a USD file, or a scenario (.json)"
    )
    render.add_argument(
        "--sailenv",
        action="store_true",
        help="the source is a script for SAILenv (.py), which is run once without rendering, or its scenario (.json)",
    )
    render.add_argument("-o", "--output", metavar="DIR", required=True, help="folder to write")
    render.add_argument(
        "--frames",
        metavar="A:B[:STEP]",
        type=frame_slice,
        help="frames as a Python slice: 3:10 is 3 to 9, :10 is 0 to 9, 0:10:2 is every second one; 5: is from 5 on and "
        "needs --count; 7 is frame 7 alone (default: 0; with --count 0:)",
    )
    render.add_argument(
        "--count", metavar="N", type=int, help="at most N of these frames: --frames 5: --count 10 is 5:15"
    )
    render.add_argument(
        "--buffers",
        metavar="NAME,...",
        type=name_list,
        help="buffers to write, or 'all' (default: those that the format requires, else "
        "rgb,semantic,instance,depth,forward_flow)",
    )
    render.add_argument("--format", metavar="NAME", default="png", help=f"{', '.join(FORMATS)} (default: %(default)s)")
    render.add_argument(
        "--objects",
        choices=("moving", "visible", "all"),
        help="write the table of the moving, visible or all objects of each frame (default: no table)",
    )
    add_parts(render)
    render.add_argument("--overwrite", action="store_true", help="replace frames that were made with other settings")
    _add_size(render, width=None, height=None)
    render.add_argument(
        "--fps", metavar="N", type=float, default=25.0, help="frame k shows time k / fps (default: %(default)g)"
    )
    _add_quality(render, "standard")
    _add_spp(render)
    render.add_argument(
        "--max-depth", metavar="N", type=int, help="maximum path depth in segments (default: by --quality)"
    )
    render.add_argument("--denoise", action=argparse.BooleanOptionalAction, help="denoise rgb (default: yes)")
    render.add_argument(
        "--relative-error",
        metavar="FRACTION",
        type=float,
        help="sample each pixel until its estimated standard error is this fraction of its luminance, such as 0.02 "
        "(at most --spp samples)",
    )
    render.add_argument(
        "--clamp",
        metavar="MAX",
        type=float,
        help="maximum radiance of a sample, W/m²/sr: removes fireflies and some light (default: none)",
    )
    render.add_argument(
        "--pixel-filter",
        metavar="NAME",
        help="box, triangle, gaussian, mitchell or blackman-harris (default: by --quality)",
    )
    render.add_argument(
        "--shutter",
        metavar="OPEN,CLOSE",
        type=number_list,
        help="motion blur of color: when the shutter opens and closes, in frames from each frame, such as 0,0.5 "
        "(default: the camera's)",
    )
    _add_seed(render)
    render.add_argument(
        "--camera",
        metavar="NAME,...",
        type=name_list,
        help="one or more cameras of the scene (default: its first); each of several writes into its own folder",
    )
    render.add_argument(
        "--time-code", metavar="T", type=float, help="show the stage at this time code, static (default: it plays)"
    )
    render.add_argument(
        "--incremental",
        action=argparse.BooleanOptionalAction,
        help="render frames of a static camera as a base image plus what movers change (default: by --quality)",
    )
    render.add_argument(
        "--categories",
        metavar="NAME,...",
        type=name_list,
        help="categories with the ids 1, 2, ... in semantic; everything else is 0 (default: all, with the ids that "
        "`tiscene list --json` prints)",
    )
    _add_reading(render)
    _add_arch(render)


def _preview(commands: Commands) -> None:
    preview = commands.add_parser(
        "preview",
        help="write frames as one HTML page that plays them, with the values under the cursor",
        description="Write one page that any browser opens from disk: a player with all buffers, the values under the "
        "cursor, a table of objects, and trajectories seen from above.",
    )
    preview.add_argument("-o", "--output", metavar="FILE", required=True, help="page to write, such as preview.html")
    _add_shown_stream(preview)


def _view(commands: Commands) -> None:
    view = commands.add_parser(
        "view", help="show frames in Rerun while they are rendered (needs pip install 'tiscene[rerun]')"
    )
    view.add_argument("--save", metavar="FILE", help="write a file for Rerun instead, such as run.rrd")
    view.add_argument("--connect", metavar="URL", help="send frames to a viewer that runs already")
    _add_shown_stream(view)


def _add_shown_stream(command: argparse.ArgumentParser) -> None:
    """Add the arguments of `stream_arguments.stream_of`."""
    command.add_argument(
        "source", metavar="SCENE_OR_SCENARIO", help="the name of a scene, a USD file, or a scenario (.json)"
    )
    command.add_argument(
        "--frames", metavar="A:B[:STEP]", type=frame_slice, help="frames as a Python slice (default: 0:100)"
    )
    command.add_argument(
        "--buffers",
        metavar="NAME,...",
        type=name_list,
        help="buffers to show, or 'all' (default: rgb,semantic,instance,depth,forward_flow,normal)",
    )
    _add_size(command, width=None, height=None)
    command.add_argument(
        "--fps", metavar="N", type=float, default=25.0, help="frame k shows time k / fps (default: %(default)g)"
    )
    _add_quality(command, "fast")
    _add_spp(command)
    _add_seed(command)
    command.add_argument(
        "--camera", metavar="NAME,...", type=name_list, help="cameras of the scene (default: its first)"
    )
    _add_reading(command)
    _add_arch(command)


def _list(commands: Commands) -> None:
    listing = commands.add_parser("list", help="list scenes, object templates and buffers")
    listing.add_argument("--json", action="store_true", help="print JSON, with the ids of categories")


def _show(commands: Commands) -> None:
    show = commands.add_parser("show", help="show the size, cameras, lights, objects and templates of a scene")
    show.add_argument("scene", metavar="SCENE", help="the name of a scene, a USD file, or a scenario (.json)")


def _inspect(commands: Commands) -> None:
    inspect = commands.add_parser(
        "inspect", help="report the contents of a USD file, which of them are rendered, and which are not and why"
    )
    inspect.add_argument("file", metavar="FILE", help="a USD file, the name of a scene, or a scenario (.json)")
    inspect.add_argument("--json", action="store_true", help="print the report as JSON")
    _add_reading(inspect)


def _import(commands: Commands) -> None:
    importer = commands.add_parser(
        "import",
        help="make a template of a model (OBJ, glTF, PLY, STL, USD) or of each model of a furniture catalog (.sh3f)",
        description="Make a template of a model file. Its license files are kept in the template's metadata.",
    )
    importer.add_argument("file", metavar="FILE", help="the model, or a Sweet Home 3D furniture catalog")
    importer.add_argument("-o", "--output", metavar="DIR", help="library (default: the first folder of TISCENE_PATH)")
    importer.add_argument(
        "--name", metavar="TEXT", default="", help="name, such as 'Chair 03' (default: from the file name)"
    )
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
    bench = commands.add_parser("bench", help="measure frames per second on this machine")
    bench.add_argument(
        "scene", metavar="SCENE", nargs="?", help="the name of a scene or a USD file (default: the demo's)"
    )
    bench.add_argument(
        "--seconds", metavar="S", type=float, default=3.0, help="duration of each measurement (default: %(default)g)"
    )
    _add_arch(bench)


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
        help="a suite (solids, room; solids-hard for another grade), a course (.json), or with --verify a score",
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
    evaluate.add_argument("-o", "--output", metavar="DIR", help="folder to write (default: tiscene-evaluation-COURSE)")
    evaluate.add_argument(
        "--cost",
        metavar="FRAMES",
        type=float,
        default=0.0,
        help="frames that pass while a learner learns from one; it misses them (default: 0, the stream waits)",
    )
    evaluate.add_argument(
        "--checkpoint", action="store_true", help="save the state from time to time; the same command continues from it"
    )
    evaluate.add_argument("--verify", action="store_true", help="COURSE is a saved score: compute it again and compare")


def _serve(commands: Commands) -> None:
    serve = commands.add_parser(
        "serve",
        help="serve unmodified SAILenv clients",
        description="Serve one world to SAILenv clients (see docs/sailenv.md). Ctrl-C or SIGTERM stops it cleanly.",
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
    serve.add_argument("--fps", metavar="N", type=float, default=25.0, help="frames per second (default: %(default)g)")
    _add_quality(serve, "preview")
    _add_spp(serve)
    serve.add_argument(
        "--incremental",
        action=argparse.BooleanOptionalAction,
        help="frames of a camera that stands still do not flicker; their first one waits for a base image "
        "(default: by --quality)",
    )
    _add_seed(serve)
    serve.add_argument(
        "--consecutive-flow",
        action="store_true",
        help="flow is always that from the frame before (default: from the client's last frame)",
    )
    serve.add_argument(
        "--keep-clock",
        action="store_true",
        help="the frame clock goes on when a client changes the scene (default: it starts again, as in SAILenv)",
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
    _add_arch(serve)
    serve.add_argument("-v", "--verbose", action="count", default=0, help="log each event; -vv: each frame too")


def _sailenv(commands: Commands) -> None:
    sailenv = commands.add_parser("sailenv", help="record what SAILenv scripts and scenarios show")
    actions = sailenv.add_subparsers(title="actions", dest="action", metavar="ACTION", required=True)
    record = actions.add_parser(
        "record",
        help="run a script or play a scenario, and record the frames in the layout of SAILenv's recordings",
        description="Run a script, or play a scenario (.json), and record each frame that its first agent receives: "
        "color, flow, a class for each pixel, and a focus of attention (see docs/sailenv.md).",
    )
    record.add_argument("source", metavar="SCRIPT_OR_SCENARIO", help="a Python file that imports sailenv, or JSON")
    record.add_argument("-o", "--output", metavar="DIR", required=True, help="folder to write")
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
    record.add_argument("--fps", metavar="N", type=float, default=25.0, help="frames per second (default: %(default)g)")
    record.add_argument("--width", metavar="PX", type=int, help="image width for a scenario (default: 256)")
    record.add_argument("--height", metavar="PX", type=int, help="image height for a scenario (default: 192)")
    _add_quality(record, "preview")
    _add_spp(record)
    record.add_argument(
        "--incremental",
        action=argparse.BooleanOptionalAction,
        help="frames of a camera that stands still do not flicker (default: by --quality)",
    )
    _add_seed(record)
    _add_arch(record)
    record.add_argument("arguments", nargs="*", metavar="ARGUMENT", help="arguments of the script, after --")


def _add_size(command: argparse.ArgumentParser, width: int | None, height: int | None) -> None:
    """Add the size of images. None: that of the stage's RenderSettings, else 256 x 192."""
    for name, default, usual in (("width", width, 256), ("height", height, 192)):
        text = "%(default)s" if default else f"of the stage's RenderSettings, else {usual}"
        command.add_argument(
            f"--{name}", metavar="PX", type=int, default=default, help=f"image {name} (default: {text})"
        )


def _add_quality(command: argparse.ArgumentParser, default: str) -> None:
    command.add_argument(
        "--quality",
        metavar="NAME",
        default=default,
        help="preset: fast, preview, standard or photo (default: %(default)s)",
    )


def _add_spp(command: argparse.ArgumentParser) -> None:
    command.add_argument("--spp", metavar="N", type=int, help="samples per pixel (default: by --quality)")


def _add_seed(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--seed", metavar="N", type=int, default=0, help="seed of the rendering (default: %(default)s)"
    )


def _add_arch(command: argparse.ArgumentParser) -> None:
    command.add_argument("--arch", metavar="NAME", help="cpu or cuda (default: cpu)")


def _add_reading(command: argparse.ArgumentParser) -> None:
    """Add the arguments that decide how a stage is read."""
    command.add_argument(
        "--variant",
        metavar="PRIM{SET}=NAME",
        type=variant_choice,
        action="append",
        default=[],
        help="select a variant of the stage, such as '/Room{lighting}=evening'; may be repeated",
    )
    command.add_argument(
        "--taxonomy", metavar="NAME", help="taxonomy of semantic labels (default: class, else category)"
    )
    command.add_argument("--root", metavar="DIR", help="refuse layers and textures outside this folder")
    command.add_argument("--strict", action="store_true", help="refuse a stage with a broken part or a missing file")
    command.add_argument(
        "--subdivision",
        metavar="TRIANGLES",
        type=int,
        help="triangles that all subdivision surfaces are refined to at most (default: 3000000; 0: not refined)",
    )
    command.add_argument("--untrusted", action="store_true", help="read the stage in a separate process with limits")
