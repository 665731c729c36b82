# SPDX-License-Identifier: Apache-2.0
"""Run SAILenv scripts in this process: `import sailenv` finds the classes of `tiscene.sailenv`."""

from __future__ import annotations

import builtins
import importlib
import json
import os
import runpy
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar

from numpy.typing import NDArray

from tiscene.errors import ArgumentError, MissingFile, ScenarioError
from tiscene.sailenv.agent import Agent
from tiscene.sailenv.agent_camera import AgentCamera
from tiscene.sailenv.environment import Environment
from tiscene.sailenv.module_aliases import CONTENTS, install

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
    """All agents of the script together have received the number of frames that was asked for."""


class ScriptAgent(Agent):
    """An agent of a script. A subclass for each run sets the attributes, by `agent_class`.

    Attributes:
        settings: Arguments that override those of the script.
        limit: The number of frames after which the script ends; None for no limit.
        frame_count: The number of frames that all agents have received.
    """

    settings: ClassVar[Mapping[str, Any]] = {}
    limit: ClassVar[int | None] = None
    frame_count: ClassVar[int] = 0

    def __init__(self, *positional: Any, **named: Any) -> None:
        super().__init__(*positional, **{**named, **self.settings})

    def _render(
        self, environment: Environment, camera: AgentCamera, views: Sequence[str]
    ) -> tuple[dict[str, NDArray[Any]], float]:
        cls = type(self)
        if cls.limit is not None and cls.frame_count >= cls.limit:
            raise FrameLimitReached(0)
        cls.frame_count += 1
        return super()._render(environment, camera, views)


def existing(path: Path) -> Path:
    """Return the path of a file. Raises MissingFile if there is none."""
    if not path.is_file():
        raise MissingFile(f"no file {str(path)!r}")
    return path


def agent_class(base: type[ScriptAgent], **attributes: Any) -> Any:
    """Return a subclass of ScriptAgent with class attributes, under the name that scripts know."""
    return type("Agent", (base,), attributes)


def run_script(path: Path, arguments: Sequence[str], agent: type[Agent], *, headless: bool) -> None:
    """Run a script until its end, or until its agents raise FrameLimitReached.

    Args:
        path: The script.
        arguments: Its command-line arguments.
        agent: The class that it imports as `Agent`.
        headless: Whether windows and key presses do nothing.

    Raises:
        MissingFile: There is no such script.
        SystemExit: As the script raises it, or because it needs OpenCV.
    """
    existing(path)
    if headless:
        make_headless()
    with _restored_process():
        install(agent)
        sys.argv = [str(path), *arguments]
        sys.path.insert(0, str(path.resolve().parent))
        try:
            runpy.run_path(str(path), run_name="__main__")
        except FrameLimitReached:
            pass
        except ModuleNotFoundError as error:
            if error.name == "cv2":
                raise SystemExit(f"{path.name} needs OpenCV: pip install opencv-python-headless") from error
            raise


def run_scenario(path: Path, agent: type[ScriptAgent], size: tuple[int, int]) -> None:
    """Play a scenario in SAILenv's JSON with an agent that stays where it starts, until FrameLimitReached.

    Args:
        path: The JSON file.
        agent: The class of the agent; it needs a limit.
        size: Width and height of its image, px.

    Raises:
        MissingFile, ScenarioError: The file does not exist or is no scenario.
        ArgumentError: The agent has no limit.
    """
    existing(path)
    if agent.limit is None:
        raise ArgumentError(f"{path.name} has no end: give the number of frames (--frames)")
    try:
        content = json.loads(path.read_text("utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        raise ScenarioError(f"{path}: cannot be read as JSON: {error}") from error
    if not isinstance(content, dict) or "scene_name" not in content:
        raise ScenarioError(f'{path}: not a scenario of SAILenv: it should be an object with "scene_name"')
    player = agent(width=size[0], height=size[1], strict=True, port=0)
    player.register()
    try:
        _, problems = player._load_scenario(content)
        if problems:
            raise ScenarioError(f"{path}: {'; '.join(problems)}")
        while True:
            player.get_frame()
    except FrameLimitReached:
        pass
    finally:
        player.delete()


def run_source(
    path: Path, arguments: Sequence[str], agent: type[ScriptAgent], *, size: tuple[int, int], headless: bool = True
) -> None:
    """Run a script (.py), or play a scenario (.json) with an image size; see `run_script` and `run_scenario`."""
    if path.suffix.lower() == ".json":
        run_scenario(path, agent, size)
    else:
        run_script(path, arguments, agent, headless=headless)


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


@contextmanager
def _restored_process() -> Iterator[None]:
    """Undo changes of `sys.argv`, `sys.path`, `input` and the modules of `sailenv` after the block."""
    argv, path, modules, ask = sys.argv, list(sys.path), {name: sys.modules.get(name) for name in CONTENTS}, input
    try:
        yield
    finally:
        sys.argv, sys.path[:], builtins.input = argv, path, ask
        for name, module in modules.items():
            if module is None:
                sys.modules.pop(name, None)
            else:
                sys.modules[name] = module
