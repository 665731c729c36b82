# SPDX-License-Identifier: Apache-2.0
"""`tiscene sailenv record`: run a SAILenv script, or play a scenario, and record what the agent receives."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

from numpy.typing import NDArray

from tiscene.cli.terminal import note, progress
from tiscene.errors import ArgumentError, counted
from tiscene.export.sailenv_recorder import SailenvRecorder
from tiscene.sailenv.agent_camera import AgentCamera
from tiscene.sailenv.environment import Environment
from tiscene.sailenv.recorded_classes import RecordedClasses
from tiscene.sailenv.script_runner import FrameLimitReached, ScriptAgent, agent_class, existing, run_source

VIEWS = ("main", "category", "flow")


class RecordedAgent(ScriptAgent):
    """An agent of a script that is recorded: the first one that asks for a frame."""

    recorder: ClassVar[SailenvRecorder]
    step: ClassVar[Any]
    recorded: ClassVar[int | None] = None

    def _render(
        self, environment: Environment, camera: AgentCamera, views: Sequence[str]
    ) -> tuple[dict[str, NDArray[Any]], float]:
        cls = type(self)
        cls.recorded = camera.id if cls.recorded is None else cls.recorded
        if camera.id != cls.recorded:
            return environment.frame(camera, views)
        frame, seconds = super()._render(environment, camera, tuple(dict.fromkeys((*views, *VIEWS))))
        self.recorder.write(frame["main"], frame["flow"], frame["category"], environment.categories())
        cls.step(task=f"frame {self.recorder.count}")
        return {name: frame[name] for name in views}, seconds


def run(args: argparse.Namespace) -> None:
    """Record, and print the folder. An interrupted recording is ended at its last frame."""
    if args.frames is not None and args.frames < 1:
        raise ArgumentError(f"--frames {args.frames}: must be at least 1")
    source = existing(Path(args.source))  # before an earlier recording is deleted
    classes = RecordedClasses.chosen(args.classes)
    recorder = SailenvRecorder(Path(args.output), args.fps, classes, overwrite=args.overwrite)
    settings = {"fps": args.fps, "quality": args.quality, "spp": args.spp, "seed": args.seed, "arch": args.arch}
    settings |= {"incremental": args.incremental, "scene": args.scene, "physics": args.physics}
    with progress(f"running {source.name}", args.frames or 0) as step:
        agent = agent_class(
            RecordedAgent,
            recorder=recorder,
            step=staticmethod(step),
            limit=args.frames,
            settings={name: value for name, value in settings.items() if value is not None},
        )
        try:
            size = args.width or 256, args.height or 192
            run_source(source, args.script_arguments, agent, size=size, headless=not args.windows)
        except FrameLimitReached:
            pass
        except KeyboardInterrupt:
            if recorder.count:
                recorder.finish(focus=False)
                note(f"Interrupted: {counted(recorder.count, 'frame')} in {args.output}")
            raise
    recorder.finish(focus=args.focus)
    print(args.output)
