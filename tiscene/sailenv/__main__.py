# SPDX-License-Identifier: Apache-2.0
"""`python -m tiscene.sailenv SCRIPT [arguments]`: run a SAILenv script without a SAILenv server.

The script's `import sailenv` gets the classes of `tiscene.sailenv`. With --headless, windows and key presses do
nothing.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from tiscene.errors import counted
from tiscene.sailenv.script_runner import ScriptAgent, agent_class, run_script


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a script.

    Args:
        arguments: Command-line arguments; None for those of this process.

    Raises:
        SystemExit: As the script raises it, or for invalid arguments.
    """
    args = _parser().parse_args(arguments)
    script = Path(args.script)
    if not script.is_file():
        _parser().error(f"no file {args.script!r}")
    names = ("quality", "spp", "seed", "incremental", "physics", "together", "world", "strict")
    settings = {name: value for name in names if (value := getattr(args, name)) is not None}
    agent = agent_class(ScriptAgent, settings=settings, limit=args.frames)
    run_script(script, args.arguments, agent, headless=args.headless)
    if args.frames is not None and agent.frame_count >= args.frames:
        print(f"{script.name}: stopped after {counted(args.frames, 'frame')}")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tiscene.sailenv", description=__doc__)
    parser.add_argument("--headless", action="store_true", help="windows and key presses do nothing")
    parser.add_argument("--frames", type=int, metavar="N", help="end the script when it requests frame N + 1")
    parser.add_argument("--quality", help="preset: fast, preview, standard or photo (default: preview)")
    parser.add_argument("--spp", type=int, help="samples per pixel (default: by --quality)")
    parser.add_argument(
        "--incremental",
        action=argparse.BooleanOptionalAction,
        help="frames of a camera that stands still do not flicker; their first one waits for a base image or a "
        "panorama (default: by --quality)",
    )
    parser.add_argument("--seed", type=int, help="seed of the rendering (default: 0)")
    parser.add_argument("--physics", action="store_true", default=None, help="objects fall and are pushed")
    parser.add_argument("--together", action="store_true", default=None, help="all agents change the scene together")
    parser.add_argument(
        "--world", metavar="SCENE", help="a scene with rooms, such as home_01, that agents walk through"
    )
    parser.add_argument("--strict", action="store_true", default=None, help="raise the errors that SAILenv prints")
    parser.add_argument("script", metavar="SCRIPT", help="a Python file that imports sailenv")
    parser.add_argument("arguments", nargs=argparse.REMAINDER, help="arguments of the script")
    return parser


if __name__ == "__main__":
    main()
