# SPDX-License-Identifier: Apache-2.0
"""`python -m tiscene.sailenv SCRIPT [arguments]`: run a script that was written for SAILenv, without its server."""

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

WINDOWS = (
    "imshow",
    "namedWindow",
    "destroyWindow",
    "destroyAllWindows",
    "moveWindow",
    "resizeWindow",
    "startWindowThread",
)


class EnoughFrames(SystemExit):
    """The script has had as many frames as it was to have."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line (default: this process's). Leaves as the script does."""
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
    except EnoughFrames:
        print(f"{script.name}: stopped after {args.frames} frames")
    except ModuleNotFoundError as error:
        if error.name == "cv2":
            raise SystemExit(f"{script.name} needs OpenCV: pip install opencv-python-headless") from error
        raise


def make_headless() -> None:
    """Let what would open a window or wait for a key do nothing: OpenCV, matplotlib, `input`."""
    os.environ["MPLBACKEND"] = "Agg"
    builtins.input = lambda prompt="": print(prompt) or ""
    try:
        cv2: Any = importlib.import_module("cv2")
    except ModuleNotFoundError:
        return  # said when the script asks for it
    for name in WINDOWS:
        setattr(cv2, name, lambda *_, **__: None)
    for name in ("waitKey", "waitKeyEx", "pollKey"):
        setattr(cv2, name, lambda *_, **__: -1)


def _agent_class(args: argparse.Namespace) -> type[Agent]:
    """Agent, with the command line's settings and its limit of frames for all agents together."""
    given = {"strict": args.strict or None, "quality": args.quality, "spp": args.spp, "seed": args.seed}
    settings = {name: value for name, value in given.items() if value is not None}

    class ScriptAgent(Agent):
        taken = 0

        def __init__(self, *positional: Any, **named: Any) -> None:
            super().__init__(*positional, **{**settings, **named})

        def get_frame(self) -> dict[str, Any]:
            if args.frames is not None and ScriptAgent.taken >= args.frames:
                raise EnoughFrames(0)
            ScriptAgent.taken += 1
            return super().get_frame()

    ScriptAgent.__name__ = ScriptAgent.__qualname__ = "Agent"
    return ScriptAgent


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tiscene.sailenv", description=__doc__)
    parser.add_argument("--headless", action="store_true", help="windows and waiting for keys do nothing")
    parser.add_argument("--frames", type=int, metavar="N", help="end the script when it asks for frame N + 1")
    parser.add_argument("--quality", help="fast, preview, standard or photo (default: preview)")
    parser.add_argument("--spp", type=int, help="samples per pixel, instead of the quality's")
    parser.add_argument("--seed", type=int, help="of the rendering's random numbers (default: 0)")
    parser.add_argument("--strict", action="store_true", help="raise errors that SAILenv prints")
    parser.add_argument("script", metavar="SCRIPT", help="a Python file that imports sailenv")
    parser.add_argument("arguments", nargs=argparse.REMAINDER, help="what the script is given")
    return parser


if __name__ == "__main__":
    main()
