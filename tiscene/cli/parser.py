# SPDX-License-Identifier: Apache-2.0
"""Arguments of all commands."""

from __future__ import annotations

import argparse
from typing import TypeAlias

import tiscene

Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"


def parser() -> argparse.ArgumentParser:
    """Every command and its arguments."""
    top = argparse.ArgumentParser(
        prog="tiscene", description="Labelled, path-traced, exactly repeatable frame streams from USD scenes."
    )
    top.add_argument("--version", action="version", version=f"tiscene {tiscene.__version__}")
    commands = top.add_subparsers(title="commands", dest="command", metavar="COMMAND")
    for add in (_demo, _render, _list, _show, _inspect, _import, _bench, _serve):
        add(commands)
    return top


def _demo(commands: Commands) -> None:
    demo = commands.add_parser("demo", help="render a short scenario and show every buffer of it")
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
        description="Write frames into a folder, beside a manifest (tiscene.json). The same command goes on after an "
        "interruption: frames whose files are there are not rendered again.",
    )
    render.add_argument("source", metavar="SCENE_OR_SCENARIO", help="a scene's name, a USD file, or a scenario (.json)")
    render.add_argument("-o", "--output", metavar="DIR", required=True, help="folder to write")
    render.add_argument(
        "--frames", metavar="A:B", type=_frames, default=range(1), help="frames A to B - 1, or one frame K (default: 0)"
    )
    render.add_argument(
        "--buffers",
        metavar="NAME,...",
        type=_names,
        help="or 'all' (default: what the format needs, else rgb,semantic,instance,depth,forward_flow)",
    )
    render.add_argument(
        "--format", metavar="NAME", default="png", help="png, exr, npz, cryptomatte or sailenv (default: %(default)s)"
    )
    render.add_argument("--objects", action="store_true", help="write the table of objects of each frame as well")
    render.add_argument("--overwrite", action="store_true", help="replace frames that were made with other settings")
    _add_size(render, width=256, height=192)
    render.add_argument(
        "--fps", metavar="N", type=float, default=25.0, help="frame k shows time k / fps (default: %(default)g)"
    )
    _add_quality(render, "standard")
    _add_spp(render)
    render.add_argument("--max-depth", metavar="N", type=int, help="edges of a path, instead of the quality's")
    render.add_argument(
        "--denoise", action=argparse.BooleanOptionalAction, help="take the noise out of rgb (default: yes)"
    )
    render.add_argument(
        "--error",
        metavar="PART",
        type=float,
        help="samples until a pixel's error is this part of its light, such as 0.02 (at most --spp)",
    )
    render.add_argument(
        "--clamp", metavar="MOST", type=float, help="the most that one sample brings, W/m²/sr: less noise, less light"
    )
    render.add_argument("--pixel-filter", metavar="NAME", help="box, triangle, gaussian, mitchell or blackman-harris")
    render.add_argument(
        "--shutter",
        metavar="OPEN,CLOSE",
        type=_times,
        help="blur what moves between these frames from each frame, such as 0,0.5 (default: as the camera says)",
    )
    _add_seed(render)
    render.add_argument(
        "--camera",
        metavar="NAME,...",
        type=_names,
        help="a camera of the scene (default: its first); of several each writes into a folder of its own",
    )
    render.add_argument(
        "--time-code", metavar="T", type=float, help="show the stage as it is then, still (default: it plays)"
    )
    render.add_argument(
        "--incremental",
        action=argparse.BooleanOptionalAction,
        help="trace only what moves before a camera that does not (default: if there are frames enough for it to pay)",
    )
    _add_reading(render)
    _add_arch(render)


def _list(commands: Commands) -> None:
    commands.add_parser("list", help="list scenes, object templates and buffers")


def _show(commands: Commands) -> None:
    show = commands.add_parser("show", help="show what a scene holds: size, cameras, lights, objects, templates")
    show.add_argument("scene", metavar="SCENE", help="a scene's name, a USD file, or a scenario (.json)")


def _inspect(commands: Commands) -> None:
    inspect = commands.add_parser(
        "inspect", help="say what is in a USD file, what is rendered of it, what is not and why"
    )
    inspect.add_argument("file", metavar="FILE", help="a USD file, a scene's name, or a scenario (.json)")
    _add_reading(inspect)


def _import(commands: Commands) -> None:
    importer = commands.add_parser(
        "import",
        help="make a template of a model: OBJ, glTF, PLY, STL, USD, or a catalog of furniture (.sh3f)",
        description="Make a template of a model file. Its license files are kept in the template's metadata.",
    )
    importer.add_argument("file", metavar="FILE", help="the model, or a Sweet Home 3D catalog for all of its models")
    importer.add_argument("-o", "--output", metavar="DIR", help="library (default: the first folder of TISCENE_PATH)")
    importer.add_argument("--name", metavar="TEXT", default="", help="such as 'Chair 03' (default: the file's)")
    importer.add_argument("--label", metavar="TEXT", default="", help="semantic class, such as chair")
    importer.add_argument(
        "--unit", metavar="M", type=float, help="meters per unit of the file (default: as the format has it)"
    )
    importer.add_argument("--up", choices=("Y", "Z"), help="the file's up axis (default: as the format has it)")
    importer.add_argument("--keep-origin", action="store_true", help="do not move the origin to the box's center")
    importer.add_argument("--author", metavar="TEXT", default="", help="who made it")
    importer.add_argument(
        "--license", metavar="TEXT", default="", help="its text, or a file (default: the license files beside it)"
    )


def _bench(commands: Commands) -> None:
    bench = commands.add_parser("bench", help="measure frames per second on this machine")
    bench.add_argument("scene", metavar="SCENE", nargs="?", help="a scene's name or a USD file (default: the demo's)")
    bench.add_argument(
        "--seconds", metavar="S", type=float, default=3.0, help="for each line of the table (default: %(default)g)"
    )
    _add_arch(bench)


def _serve(commands: Commands) -> None:
    serve = commands.add_parser(
        "serve",
        help="speak SAILenv's protocol, for its unmodified clients",
        description="Serve one world to SAILenv's clients (see docs/sailenv.md). Ends cleanly by Ctrl-C or SIGTERM.",
    )
    serve.add_argument("scene", metavar="SCENE", nargs="?", help="where the world begins (default: SAILenv's)")
    serve.add_argument(
        "--host",
        metavar="ADDRESS",
        default="127.0.0.1",
        help="address to listen at (default: %(default)s, this machine)",
    )
    serve.add_argument("--port", metavar="N", type=int, default=8085, help="0: any that is free (default: %(default)s)")
    serve.add_argument(
        "--fps", metavar="N", type=float, default=25.0, help="frames are 1 / fps s apart (default: %(default)g)"
    )
    _add_quality(serve, "preview")
    _add_spp(serve)
    _add_seed(serve)
    serve.add_argument(
        "--wait", type=float, default=1.0, metavar="S", help="for a client that is behind (default: %(default)g)"
    )
    _add_arch(serve)
    serve.add_argument("-v", "--verbose", action="count", default=0, help="a line for each event; -vv: for each frame")


def _add_size(command: argparse.ArgumentParser, width: int, height: int) -> None:
    command.add_argument("--width", metavar="PX", type=int, default=width, help="(default: %(default)s)")
    command.add_argument("--height", metavar="PX", type=int, default=height, help="(default: %(default)s)")


def _add_quality(command: argparse.ArgumentParser, default: str) -> None:
    command.add_argument(
        "--quality", metavar="NAME", default=default, help="fast, preview, standard or photo (default: %(default)s)"
    )


def _add_spp(command: argparse.ArgumentParser) -> None:
    command.add_argument("--spp", metavar="N", type=int, help="samples per pixel, instead of the quality's")


def _add_seed(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--seed", metavar="N", type=int, default=0, help="of the rendering's random numbers (default: %(default)s)"
    )


def _add_arch(command: argparse.ArgumentParser) -> None:
    command.add_argument("--arch", metavar="NAME", help="cpu or cuda (default: cpu)")


def _add_reading(command: argparse.ArgumentParser) -> None:
    """How a stage is read."""
    command.add_argument(
        "--variant",
        metavar="PRIM{SET}=NAME",
        type=_variant,
        action="append",
        default=[],
        help="select a variant of the stage, such as '/Room{lighting}=evening'; may be repeated",
    )
    command.add_argument("--taxonomy", metavar="NAME", help="of the semantic labels (default: class, else category)")
    command.add_argument("--root", metavar="DIR", help="refuse layers and textures outside this folder")
    command.add_argument("--untrusted", action="store_true", help="read it in a process of its own, with limits")


def _frames(text: str) -> range:
    """Python's slices: "3:10" is 3 to 9, ":10" is 0 to 9, "0:10:2" every second one; and "3" is frame 3 alone."""
    mistake = argparse.ArgumentTypeError(f"{text!r} is not A:B with 0 <= A < B, such as 0:100")
    try:
        parts = text.split(":")
        start = int(parts[0] or "0")
        frames = range(int(text), int(text) + 1) if len(parts) == 1 else range(start, *map(int, parts[1:]))
    except (ValueError, TypeError):
        raise mistake from None
    if len(frames) == 0 or min(frames) < 0:
        raise mistake
    return frames


def _names(text: str) -> tuple[str, ...]:
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    if not names:
        raise argparse.ArgumentTypeError(f"{text!r} names nothing")
    return names


def _times(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not two numbers of frames, such as 0,0.5") from None


def _variant(text: str) -> tuple[str, str]:
    """ "/Room{lighting}=evening" as ("/Room{lighting}", "evening")."""
    place, _, choice = text.partition("=")
    if not (place.startswith("/") and "{" in place and place.endswith("}") and choice):
        raise argparse.ArgumentTypeError(f"{text!r} is not PRIM{{SET}}=NAME, such as /Room{{lighting}}=evening")
    return place, choice
