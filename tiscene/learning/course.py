# SPDX-License-Identifier: Apache-2.0
"""Course: phases one after another, as one exactly repeatable sequence of frames.

As of a stream, frame k depends only on the course and k: `course[k]` equals the k-th frame of iterating, byte for byte.
"""

from __future__ import annotations

import bisect
import hashlib
import itertools
import json
import operator
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, overload

from dynamics import argument_checks
from tiscene.errors import ArgumentError, ArgumentTypeError, counted
from tiscene.frame.buffers import buffer_names
from tiscene.frame.object_table import ObjectTable
from tiscene.learning import course_file
from tiscene.learning.phase import CourseFrame, Phase, check_phases
from tiscene.learning.pixel_counts import check_pixels
from tiscene.learning.pixel_labels import LABELS, moving_instances
from tiscene.learning.stream_pool import StreamPool, without_progress
from tiscene.learning.supervision_rules import SILENCE, RulesAt, SupervisionRules
from tiscene.scenario import serialization
from tiscene.scenario.relative_files import from_folder
from tiscene.scenario.scenario import Scenario
from tiscene.stream.frame_slice import FrameSlice
from tiscene.stream.stream import STREAM_ARGUMENTS, Stream

VERSION = 1
DEFAULTS: dict[str, Any] = {"width": 64, "height": 48, "fps": 25.0, "quality": "fast", "buffers": ("rgb", *LABELS)}

UNUSED = {  # arguments of `Stream` and `Phase` that a course does not have, and what to do
    "frames": "give the phases frames= or laps=",
    "supervision": "give it to the phases",
    "camera": "give it to the scenarios of the phases, as Scenario.load(scene, camera=...) does",
    "variants": "give them to the scenarios of the phases, as Scenario.load(scene, variants=...) does",
    "prefetch": "frames of a course are rendered one by one; leave it out",
    "batch": "frames of a course are rendered one by one; leave it out",
}
SETTINGS = tuple(name for name in STREAM_ARGUMENTS if name not in UNUSED)


class Course(Iterator[CourseFrame]):
    """Phases one after another: an iterator with a position, indexable, with a length, as a stream with `frames=`.

    Category ids are shared by all phases and tests: 1, 2, ... in alphabetical order of all categories that occur, or in
    the order of `categories=`. A scene that several phases show is read once.

    Args:
        phases: one or more phases; their names differ.
        tests: phases on which a learner is tested between the phases, each a task. A test with the name of a phase
            belongs to it; others are tested beside. They have no teacher.
        boundaries: "hidden" or "shown": whether learners see names and boundaries of phases.
        observed: buffers that learners see.
        pixels: the pixels that scores count: "objects" (of the scenarios, without distractors), "moving" (objects) or
            "frame" (all).
        **settings: keyword arguments of `Stream`: width, height, fps, buffers, quality, categories, seed and so on, but
            not frames, camera, variants, prefetch and batch: cameras and variants are those of the scenarios. Defaults:
            64 x 48 px, quality "fast", and the buffers rgb, semantic, instance, part and depth.

    Attributes:
        phases: the phases.
        test_phases: those of the tests.

    Raises:
        TisceneError: an argument is invalid.
    """

    def __init__(
        self,
        phases: Sequence[Phase],
        *,
        tests: Sequence[Phase] = (),
        boundaries: str = "hidden",
        observed: Sequence[str] = ("rgb",),
        pixels: str = "objects",
        **settings: Any,
    ) -> None:
        self.phases = check_phases(phases, "phases")
        if not self.phases:
            raise ArgumentError("phases=(): give one phase or more")
        if boundaries not in ("hidden", "shown"):
            raise ArgumentError(f"boundaries={boundaries!r}: must be 'hidden' or 'shown'")
        for name in UNUSED.keys() & settings.keys():
            raise ArgumentError(f"{name}={settings[name]!r}: a course has no such argument; {UNUSED[name]}")
        argument_checks.known_names(settings, SETTINGS, "Course")
        self.boundaries = boundaries
        if isinstance(observed, str) or not isinstance(observed, Iterable):
            raise ArgumentError(f"observed={observed!r}: must be a sequence of buffers, such as ('rgb',)")
        self.observed = tuple(observed)
        self.pixels = check_pixels(pixels)
        self.settings: dict[str, Any] = DEFAULTS | settings
        self.settings["buffers"] = buffer_names(self.settings["buffers"])
        missing = [name for name in self.observed if name not in self.settings["buffers"]]
        if missing:
            raise ArgumentError(f"observed={self.observed!r}: {missing[0]!r} is not among buffers=")
        self.width = argument_checks.integer(self.settings["width"], "width", 1, 16384)
        self.height = argument_checks.integer(self.settings["height"], "height", 1, 16384)
        self.fps = argument_checks.positive(self.settings["fps"], "fps")
        argument_checks.integer(settings.get("seed", 0), "seed", 0, 2**32 - 1)
        if settings.get("categories") is not None:
            argument_checks.distinct_names(settings["categories"], "categories")
        self.test_phases = check_phases(tests, "tests")
        lengths = [phase.length(self.fps) for phase in self.phases]
        for phase, length in zip(self.phases, lengths, strict=True):
            phase.warn_of_idle_drift(length)
        self.starts = tuple(itertools.accumulate(lengths, initial=0))
        self._laps = [phase.laps_of_motion() for phase in self.phases]
        self._pool = StreamPool(self.settings)
        self._owns_pool = True
        self._keys: dict[tuple[int, tuple[float, ...]], tuple[str, Scenario]] = {}
        self._position = 0

    def __getstate__(self) -> dict[str, Any]:
        """Return all but the progress callback, as a stream does."""
        return {**vars(self), "settings": without_progress(self.settings)}

    @property
    def tests(self) -> Course | None:
        """The tests as a course of their own, with the same settings and category ids; None: there are none.

        Learners only predict in it, so `evaluate(learner, course.tests)` tests a learner that has learned elsewhere.
        """
        if not self.test_phases:
            return None
        shared: dict[str, Any] = {"boundaries": self.boundaries, "observed": self.observed, "pixels": self.pixels}
        phases = [replace(each, supervision=None, evaluate=True) for each in self.test_phases]
        tests = Course(phases, **shared, **self.settings)
        self._share_categories()
        tests._pool, tests._owns_pool = self._pool, False
        return tests

    @property
    def categories(self) -> dict[int, str]:
        """Names of the ids in `semantic`, in all phases and tests; 0 is the background. Reads all scenes."""
        return {0: "", **dict(enumerate(self._share_categories(), 1))}

    def _share_categories(self) -> tuple[str, ...]:
        return self._pool.share_categories(self._scenarios())

    def _scenarios(self) -> Iterator[Scenario]:
        """Yield every scenario that a frame or a test may show."""
        for phase in (*self.phases, *self.test_phases):
            positions = {phase.positions(k) for k in range(phase.length(self.fps))} if phase.drift else {()}
            for each in sorted(positions):
                yield phase.scenario_at(each)

    def phase_at(self, index: int) -> tuple[int, int]:
        """Return the number of a frame's phase, and the frame's number in it."""
        if not 0 <= index < len(self):
            raise IndexError(f"frame {index} is outside 0..{len(self) - 1}")
        number = bisect.bisect_right(self.starts, index) - 1
        return number, index - self.starts[number]

    def source(self, index: int) -> tuple[Stream, int]:
        """Return the stream that shows a frame of the course, and the frame's number there."""
        self._share_categories()
        number, k = self.phase_at(index)
        phase = self.phases[number]
        where = number, phase.positions(k)
        if where not in self._keys:
            scenario = phase.scenario_at(where[1])
            self._keys[where] = _digest(scenario.to_json()), scenario
        return self._pool.stream(*self._keys[where]), phase.start + phase.step * k

    def rules_at(self, index: int) -> RulesAt:
        """Return the rules of the teacher at a frame."""
        number, k = self.phase_at(index)
        rules = self.phases[number].supervision or SILENCE
        assert isinstance(rules, SupervisionRules)  # since Phase.__post_init__
        return RulesAt(rules, number, k, self.starts[number + 1] - self.starts[number])

    def events(self) -> dict[int, str]:
        """Return the frames at which a phase begins or a factor begins to change, with what changes there."""
        found = {start: f"phase {phase.name}" for start, phase in zip(self.starts[1:], self.phases[1:], strict=False)}
        for start, phase in zip(self.starts, self.phases, strict=False):
            found |= {start + k: factor for k, factor in phase.events(self.fps).items()}
        return {index: found[index] for index in sorted(found)}

    def observation(self, frame: CourseFrame) -> CourseFrame:
        """Return a frame as a learner sees it: copies of the observed buffers, without labels, objects and events.

        Where boundaries are hidden, its time is that of the course: index / fps. That of a scenario begins again with
        each phase.
        """
        hidden: dict[str, Any] = {"phase": "", "phase_index": 0, "boundary": False, "lap": None}
        hidden["time"] = frame.index / self.fps
        return replace(
            frame,
            buffers={name: frame[name].copy() for name in self.observed},
            objects=ObjectTable(),
            events=(),
            materials=frame.materials if "material_coverage" in self.observed else {},
            room="",
            moving=frozenset(),
            _other_views=(),
            _novelty=None,
            **(hidden if self.boundaries == "hidden" else {}),
        )

    def _render(self, index: int) -> CourseFrame:
        stream, k = self.source(index)
        number, position = self.phase_at(index)
        laps = self._laps[number]
        where = {
            "phase": self.phases[number].name,
            "phase_index": position,
            "boundary": position == 0,
            "lap": None if laps is None else laps.lap(k, self.fps),
        }
        frame = stream[k]
        moving = frozenset(moving_instances(stream.world.state(k)))
        return CourseFrame.of(frame, index=index, moving=moving, **where)

    @property
    def frames(self) -> int:
        """Number of frames, as of a stream."""
        return self.starts[-1]

    @property
    def position(self) -> int:
        """The index of the frame that `next` returns."""
        return self._position

    def seek(self, index: int) -> Course:
        """Make frame `index` the next one; costs nothing. Returns the course."""
        self._position = argument_checks.integer(index, "index", 0, len(self))
        return self

    def __iter__(self) -> Course:
        return self

    def __next__(self) -> CourseFrame:
        if self._position >= len(self):
            raise StopIteration
        frame = self._render(self._position)
        self._position += 1
        return frame

    def __len__(self) -> int:
        return self.frames

    @overload
    def __getitem__(self, index: int) -> CourseFrame: ...

    @overload
    def __getitem__(self, index: slice) -> FrameSlice: ...

    def __getitem__(self, index: int | slice) -> CourseFrame | FrameSlice:
        if isinstance(index, slice):
            return FrameSlice(self, range(len(self))[index])
        index = operator.index(index)
        from_end = -len(self) <= index < 0
        return self._render(index + len(self) if from_end else index)

    def __enter__(self) -> Course:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Free the memory of the device. The next frame allocates it again."""
        if self._owns_pool:
            self._pool.close()

    def __repr__(self) -> str:
        names = ", ".join(phase.name for phase in self.phases)
        return f"<Course of {counted(len(self), 'frame')} at frame {self._position}: {names}>"

    def digest(self) -> str:
        """Return the SHA-256 of the course as JSON."""
        return _digest(self.to_json())

    def state_dict(self) -> dict[str, Any]:
        """Return the position and the digest of the course as JSON-ready values."""
        return {"version": VERSION, "position": self._position, "course": self.digest()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue where `state_dict` was taken.

        Raises:
            ArgumentError: the state is of another course.
        """
        if not isinstance(state, Mapping) or state.get("version") != VERSION or "position" not in state:
            raise ArgumentError(f"this is not a Course.state_dict of version {VERSION}")
        if state.get("course") != self.digest():
            raise ArgumentError("the state is of another course; make the one that it was saved with")
        self.seek(state["position"])

    def to_json(self) -> dict[str, Any]:
        """Return the course as JSON values, from which `from_json` makes the same course."""
        return course_file.encode(
            {
                "settings": self.settings,
                "boundaries": self.boundaries,
                "observed": self.observed,
                "pixels": self.pixels,
                "phases": self.phases,
                "tests": self.test_phases,
            }
        )

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Course:
        """Make a course from JSON values.

        Raises:
            ArgumentError, ScenarioError: a value is wrong; the message names its place.
        """
        members = course_file.decode(content)
        return cls(members.pop("phases"), **members.pop("settings"), **members)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the course as a JSON file.

        Raises:
            ExportError: the file cannot be written.
        """
        serialization.write(path, self.to_json())

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Course:
        """Read a course from a JSON file, whose relative paths are those of `Scenario.load`.

        Raises:
            MissingFile: there is no such file.
            ArgumentError, ScenarioError: the course is invalid; the message names the file and the place in it.
        """
        folder = Path(path).parent

        def make(content: Any) -> Course:
            if isinstance(content, Mapping) and isinstance(content.get("scenarios"), Mapping):
                scenarios = {name: from_folder(each, folder) for name, each in content["scenarios"].items()}
                content = {**content, "scenarios": scenarios}
            return cls.from_json(content)

        return serialization.read(path, make)


def check_course(value: Any) -> Course:
    """Return `value`, a course."""
    if not isinstance(value, Course):
        raise ArgumentTypeError(
            f"course={argument_checks.brief(value)}: must be a Course([Phase(name, scenario, frames=100), ...])"
        )
    return value


def _digest(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
