# SPDX-License-Identifier: Apache-2.0
"""`python -m tiscene.sailenv SCRIPT [arguments]`: run a SAILenv script without a SAILenv server.

The script's `import sailenv` gets the classes of `tiscene.sailenv`. With --headless, windows and key presses do
nothing.
"""

from __future__ import annotations

import argparse
import builtins
import importlib
import os
import runpy
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tiscene.sailenv.agent import Agent
from tiscene.sailenv.module_aliases import install

OPENCV_WINDOW_FUNCTIONS = (
    "imshow",
    "namedWindow",
    "destroyWindow",
    "destroyAllWindows",
    "moveWindow",
    "resizeWindow",
    "startWindowThread",
)


class FrameLimitReached(SystemExit):
    """The script has received the number of frames given by --frames."""


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
    if args.headless:
        make_headless()
    install(_agent_class(args))
    sys.argv = [args.script, *args.arguments]
    sys.path.insert(0, str(script.resolve().parent))
    try:
        runpy.run_path(args.script, run_name="__main__")
    except FrameLimitReached:
        print(f"{script.name}: stopped after {args.frames} frames")
    except ModuleNotFoundError as error:
        if error.name == "cv2":
            raise SystemExit(f"{script.name} needs OpenCV: pip install opencv-python-headless") from error
        raise


def make_headless() -> None:
    """Disable windows and waiting for keys: of OpenCV, Matplotlib and `input`."""
    os.environ["MPLBACKEND"] = "Agg"
    builtins.input = lambda prompt="": print(prompt) or ""
    try:
        cv2: Any = importlib.import_module("cv2")
    except ModuleNotFoundError:
        return  # the script gets the error when it imports cv2
    for name in OPENCV_WINDOW_FUNCTIONS:
        setattr(cv2, name, lambda *_, **__: None)
    for name in ("waitKey", "waitKeyEx", "pollKey"):
        setattr(cv2, name, lambda *_, **__: -1)


def _agent_class(args: argparse.Namespace) -> type[Agent]:
    """Return Agent with the settings of the command line, and with a limit of frames for all agents together."""
    names = ("quality", "spp", "seed", "incremental")
    settings = {name: value for name in names if (value := getattr(args, name)) is not None}
    if args.strict:
        settings["strict"] = True

    class ScriptAgent(Agent):
        frame_count = 0

        def __init__(self, *positional: Any, **named: Any) -> None:
            super().__init__(*positional, **{**settings, **named})

        def get_frame(self) -> dict[str, Any]:
            if args.frames is not None and ScriptAgent.frame_count >= args.frames:
                raise FrameLimitReached(0)
            ScriptAgent.frame_count += 1
            return super().get_frame()

    ScriptAgent.__name__ = ScriptAgent.__qualname__ = "Agent"
    return ScriptAgent


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tiscene.sailenv", description=__doc__)
    parser.add_argument("--headless", action="store_true", help="windows and key presses do nothing")
    parser.add_argument("--frames", type=int, metavar="N", help="end the script when it requests frame N + 1")
    parser.add_argument("--quality", help="preset: fast, preview, standard or photo (default: preview)")
    parser.add_argument("--spp", type=int, help="samples per pixel (default: by --quality)")
    parser.add_argument(
        "--incremental",
        action=argparse.BooleanOptionalAction,
        help="frames of a camera that stands still do not flicker; their first one waits for a base image "
        "(default: by --quality)",
    )
    parser.add_argument("--seed", type=int, help="seed of the rendering (default: 0)")
    parser.add_argument("--strict", action="store_true", help="raise the errors that SAILenv prints")
    parser.add_argument("script", metavar="SCRIPT", help="a Python file that imports sailenv")
    parser.add_argument("arguments", nargs=argparse.REMAINDER, help="arguments of the script")
    return parser


if __name__ == "__main__":
    main()
