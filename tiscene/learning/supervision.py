# SPDX-License-Identifier: Apache-2.0
"""Supervision: a teacher that labels single pixels of a stream, on request or unasked, within a budget.

A label of a pixel costs one ray, or nothing if the frame's labels were rendered. What a teacher answers depends only on
its rules, the stream and what it was asked before: noise is drawn by (seed, frame, pixel), among categories that later
edits of the stream do not change.
"""

from __future__ import annotations

import math
import weakref
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import is_dataclass, replace
from typing import Any

import numpy as np

from dynamics import argument_checks
from tiscene.errors import ArgumentError, ArgumentTypeError, counted
from tiscene.frame.frame import Frame
from tiscene.learning.answers import Answer, Pending, Refused
from tiscene.learning.course import Course
from tiscene.learning.label_ledger import LabelLedger, LedgerRow
from tiscene.learning.phase import CourseFrame
from tiscene.learning.pixel_labels import PixelLabel, has_labels, label_in_frame, moving_instances, render_label
from tiscene.learning.supervision_rules import RulesAt, SupervisionRules
from tiscene.learning.teaching_policies import Moment, Pixel, Policy, chosen_pixels
from tiscene.stream.stream import Stream
from tiscene.world.world import World

VERSION = 1
_NOISE, _POLICY = 0x401, 0x402  # keys of random numbers


class Supervision:
    """A teacher of one stream or course.

    Args:
        stream: a Stream, or a Course whose phases have `supervision=` of their own.
        policy: which pixels it labels unasked; None: none, unless the phases say otherwise.
        silent: intervals (first frame, first frame after) in which the teacher is silent.
        **rules: further fields of `SupervisionRules`: budget, rate, per_category, every, delay, within, noise, seed.

    Attributes:
        ledger: all labels that were given.
        refused: number of refused questions by reason.

    Raises:
        ArgumentError: an argument is out of range.
    """

    def __init__(
        self,
        stream: Stream | Course,
        *,
        policy: Policy | None = None,
        silent: Sequence[tuple[int, int]] = (),
        **rules: Any,
    ) -> None:
        if not isinstance(stream, Stream | Course):
            raise ArgumentTypeError(f"stream={argument_checks.brief(stream)}: must be a Stream or a Course")
        if not isinstance(silent, Iterable):
            raise ArgumentTypeError(f"silent={silent!r}: must be intervals (first frame, first frame after)")
        self._stream = stream
        given = rules | ({} if policy is None else {"policy": policy})
        argument_checks.known_names(given, (*SupervisionRules.__dataclass_fields__, "silent"), "Supervision")
        self._rules = SupervisionRules(**given) if given or not isinstance(stream, Course) else None
        self._silent = tuple(_interval(each, f"silent[{row}]") for row, each in enumerate(silent))
        self._held: Frame | None = None
        self._held_at: tuple[object, ...] = ()
        self._held_edits = 0
        self._moving: tuple[tuple[object, ...], frozenset[int]] = (), frozenset()
        self.ledger = LabelLedger()
        self.refused: Counter[str] = Counter()
        self._given: Counter[int] = Counter()  # labels by phase
        self._by_category: Counter[tuple[int, int]] = Counter()  # by phase and true category
        self._last: dict[int, int] = {}  # the last frame with labels, by phase
        self._pending: list[tuple[int, Answer]] = []

    def __getstate__(self) -> dict[str, Any]:
        """Return all but the frame that was held last, as a copy of the stream shows a world of its own."""
        return vars(self) | {"_held": None, "_held_at": (), "_moving": ((), frozenset())}

    def __repr__(self) -> str:
        return f"<Supervision of {self._stream!r}: {counted(len(self.ledger), 'label')} given>"

    @property
    def remaining(self) -> float:
        """Labels left of the budget of the present phase; infinity without one, 0 without supervision.

        `rate` is not counted, nor when the teacher is silent.
        """
        at = self._rules_at(self.present)
        return math.inf if at.rules.budget is None else at.rules.budget - self._given[at.phase]

    @property
    def present(self) -> int:
        """The index of the frame that the learner holds.

        It is the one that was offered, held or passed last, until the stream moves on; then the one before the stream's
        position, which iterating has returned last. Frames that are taken by index do not move it.
        """
        frame = self._present_frame
        return max(self._stream.position - 1, 0) if frame is None else frame.index

    @property
    def _present_frame(self) -> Frame | None:
        """The frame that was held last; None: the stream has moved on, or shows another scenario."""
        return self._held if self._held_at == self._place else None

    @property
    def _world(self) -> World | None:
        """The world that the stream shows until `Stream.restart`; None of a course, whose worlds are not edited."""
        return None if isinstance(self._stream, Course) else self._stream.world

    @property
    def _place(self) -> tuple[object, ...]:
        """The position of the stream, and its world."""
        return self._stream.position, None if self._world is None else weakref.ref(self._world)

    def _held_frame(self, index: int) -> Frame | None:
        """Return the present frame if it is frame `index` and no edit has changed it since it was held."""
        frame = self._present_frame
        if frame is None or frame.index != index:
            return None
        later = [] if self._world is None else self._world.edits(self._held_edits, self._edit_count)
        return None if any(edit.frame <= index for edit in later) else frame

    @property
    def _edit_count(self) -> int:
        return 0 if self._world is None else self._world.edit_count

    def hold(self, frame: Frame) -> None:
        """Make a frame the present one. `offers` does this as well.

        Raises:
            ArgumentError: it is not a frame of the stream's first camera, as far as its size, number and camera tell.
        """
        if not isinstance(frame, Frame):
            raise ArgumentTypeError(f"frame={frame!r}: must be a frame of the stream")
        size, own = (frame.camera.width, frame.camera.height), (self._stream.width, self._stream.height)
        is_own = size == own and isinstance(frame, CourseFrame) == (self._world is None)
        if not is_own or not self._has(frame.index):
            raise ArgumentError(f"{frame!r}: is a frame of another stream, not of {self._stream!r}")
        if self._world is not None and (seen := frame.camera.camera.name) != self._world.camera.name:
            raise ArgumentError(f"{frame!r}: is the view of {seen!r}; a teacher labels that of the first camera")
        self._held, self._held_at, self._held_edits = frame, self._place, self._edit_count

    def ask(self, y: int, x: int, frame: Frame | int | None = None) -> Answer | Pending | Refused:
        """Ask for the label of a pixel.

        Args:
            y: row, px.
            x: column, px.
            frame: the frame or its index, past or future; None: the present one. Pass a frame that was taken by index,
                such as `stream[5]`. One that has the buffers semantic, instance, part and depth is read, unless an edit
                has changed it since; else the label costs one ray.

        Returns:
            The answer; a Pending if answers are delayed; a Refused if there is none.

        Raises:
            ArgumentError: the pixel is outside the image, a number is not whole, the frame is of another stream, or
                none is passed before the stream has returned one.
        """
        row, column = argument_checks.whole(y, "y"), argument_checks.whole(x, "x")
        if isinstance(frame, Frame):
            self.hold(frame)
        elif frame is None and self._stream.position == 0 and self._present_frame is None:
            raise ArgumentError("frame=None: the stream has returned no frame yet; pass the frame, or its index")
        index = self.present if isinstance(frame, Frame | None) else argument_checks.whole(frame, "frame")
        return self._label(row, column, index, unasked=False)

    def offers(self, frame: Frame) -> Iterator[tuple[Pixel, Answer | Pending]]:
        """Return an iterator over the labels of a frame that the policy gives unasked: pairs of pixel and answer.

        A label is given, and counts, when the iterator reaches it. It ends when the teacher is silent or its budget is
        spent.
        """
        self.hold(frame)
        return self._offers(frame)

    def _offers(self, frame: Frame) -> Iterator[tuple[Pixel, Answer | Pending]]:
        at = self._rules_at(frame.index)
        moment = self._moment(frame.index, at)
        if self._is_silent(frame.index, at.rules, moment):
            return
        for y, x in chosen_pixels(at.rules.policy, frame, moment):
            answer = self._label(y, x, frame.index, unasked=True)
            if not isinstance(answer, Refused):
                yield (y, x), answer

    def arrived(self, index: int) -> list[Answer]:
        """Return the delayed answers that arrive at a frame, or have arrived since the last call."""
        argument_checks.whole(index, "index")
        due = [answer for arrives, answer in self._pending if arrives <= index]
        self._pending = [(arrives, answer) for arrives, answer in self._pending if arrives > index]
        return due

    @property
    def awaited(self) -> int:
        """Number of labels that have been given and have not arrived."""
        return len(self._pending)

    def _rules_at(self, index: int) -> RulesAt:
        if self._rules is None:
            assert isinstance(self._stream, Course)  # since __init__
            return self._stream.rules_at(index)
        return RulesAt(self._rules, 0, index, self._stream.frames)

    def _has(self, index: int) -> bool:
        """Return whether the stream has a frame."""
        return index >= 0 and (self._stream.frames is None or index < self._stream.frames)

    def _source(self, index: int) -> tuple[Stream, int]:
        return self._stream.source(index) if isinstance(self._stream, Course) else (self._stream, index)

    def _moment(self, index: int, at: RulesAt) -> Moment:
        rng = np.random.default_rng((_POLICY, at.rules.seed, at.phase, index))
        return at.moment(rng, self._moving_at(index))

    def _moving_at(self, index: int) -> frozenset[int]:
        held = self._held_frame(index)
        if isinstance(held, CourseFrame):
            return held.moving
        key = index, self._edit_count, self._place[1]
        if self._moving[0] != key:
            source, k = self._source(index)
            self._moving = key, frozenset(moving_instances(source.world.state(k)))
        return self._moving[1]

    def _is_silent(self, index: int, rules: SupervisionRules, moment: Moment) -> bool:
        return any(first <= index < end for first, end in self._silent) or rules.policy.is_silent(moment)

    def _label(self, y: int, x: int, index: int, unasked: bool) -> Answer | Pending | Refused:
        self._check_pixel(y, x)
        at = self._rules_at(self.present)
        rules, phase = at.rules, at.phase
        if reason := self._refusal(at, index):
            return self._refused(reason)
        label = self._true_label(y, x, index)
        if rules.per_category is not None and self._by_category[phase, label.category_id] >= rules.per_category:
            return self._refused("category budget")
        self._given[phase] += 1
        self._by_category[phase, label.category_id] += 1
        self._last[phase] = at.phase_index
        label = self._noisy(label, y, x, index, rules)
        answer = Answer(**vars(label), frame=index, pixel=(y, x), asked=self.present)
        arrives = self.present + rules.delay
        self.ledger.append(LedgerRow(self.present, index, y, x, answer.category, answer.instance, arrives, unasked))
        if not rules.delay:
            return answer
        self._pending.append((arrives, answer))
        return Pending(index, (y, x), arrives)

    def _check_pixel(self, y: int, x: int) -> None:
        if not (0 <= y < self._stream.height and 0 <= x < self._stream.width):
            raise ArgumentError(f"pixel ({y}, {x}): the image is {self._stream.height} x {self._stream.width} px")

    def _refusal(self, at: RulesAt, index: int) -> str:
        """Return why a question is refused before its label is known; "" if it is not."""
        rules, given = at.rules, self._given[at.phase]
        if self._is_silent(self.present, rules, self._moment(self.present, at)):
            return "silent"
        if not self._has(index):
            return "no such frame"
        if rules.within is not None and abs(index - self.present) > rules.within:
            return "too far"
        if rules.budget is not None and given >= rules.budget:
            return "budget"
        if rules.rate is not None and given + 1 > rules.rate * (at.phase_index + 1) + 1e-9:
            return "rate"
        last = self._last.get(at.phase)
        return "too soon" if last is not None and 0 < at.phase_index - last < rules.every else ""

    def _refused(self, reason: str) -> Refused:
        self.refused[reason] += 1
        return Refused(reason)

    def _true_label(self, y: int, x: int, index: int) -> PixelLabel:
        source, k = self._source(index)
        held = self._held_frame(index)
        if held is not None and has_labels(held):
            return label_in_frame(held, y, x, int(held.instance[y, x]) in self._moving_at(index))
        return render_label(source, k, y, x)

    def _noisy(self, label: PixelLabel, y: int, x: int, index: int, rules: SupervisionRules) -> PixelLabel:
        """Replace the category of a fraction of the labels by another one, drawn by frame and pixel."""
        rng = np.random.default_rng((_NOISE, rules.seed, index, y, x))
        if rng.random() >= rules.noise:
            return label
        names = self._categories(index)
        others = [number for number in sorted(names) if number not in (0, label.category_id)]
        if not others:
            return label
        number = others[int(rng.integers(len(others)))]
        return replace(label, category_id=number, category=names[number])

    def _categories(self, index: int) -> dict[int, str]:
        """Return the categories that noise draws from; `Stream.categories` would grow with later edits."""
        if self._world is None:
            return self._stream.categories
        return {each.category_id: each.category for each in self._world.state(index).objects}

    def state_dict(self) -> dict[str, Any]:
        """Return the ledger, the counts and the pending answers as JSON-ready values, and what they belong to."""
        return {
            "version": VERSION,
            **self._origin(),
            "ledger": self.ledger.to_json(),
            "refused": dict(self.refused),
            "given": [[phase, count] for phase, count in self._given.items()],
            "by_category": [[*key, count] for key, count in self._by_category.items()],
            "last": [[phase, number] for phase, number in self._last.items()],
            "pending": [[answer.frame, *answer.pixel, answer.asked, arrives] for arrives, answer in self._pending],
        }

    def _origin(self) -> dict[str, dict[str, Any]]:
        """Return what a state belongs to: the stream or course, and the rules."""
        stream = self._stream
        rules = {"silent": self._silent} | ({} if self._rules is None else vars(self._rules))
        return {
            "stream": {"course": stream.digest()} if isinstance(stream, Course) else stream.settings(),
            "rules": {name: _text(value) for name, value in rules.items()},
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue where `state_dict` was taken, with the same rules on the same stream.

        Raises:
            ArgumentError: this is not such a state; nothing has changed then.
        """
        parts = [state.get(name) for name in ("stream", "rules")] if isinstance(state, Mapping) else [None]
        is_state = all(isinstance(part, Mapping) for part in parts)
        if not is_state or state.get("version") != VERSION:
            raise ArgumentError(f"this is not a Supervision.state_dict of version {VERSION}")
        for name, own in self._origin().items():
            if different := [key for key in {**own, **state[name]} if state[name].get(key) != own.get(key)]:
                cause = f"{name}: the state was saved with other {', '.join(different)}"
                raise ArgumentError(f"{cause}; make the same {name} again")
        try:
            ledger, refused = LabelLedger(state["ledger"]), Counter(_counts(state["refused"].items(), "refused"))
            given, last = (Counter(_counts(state[name], name)) for name in ("given", "last"))
            by_category = Counter(_counts([((a, b), n) for a, b, n in state["by_category"]], "by_category"))
            pending = [self._awaited(*row) for row in state["pending"]]
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise ArgumentError(f"this is not a Supervision.state_dict, or a damaged one: {error}") from error
        self._held = None
        self.ledger, self.refused, self._pending = ledger, refused, pending
        self._given, self._by_category, self._last = given, by_category, dict(last)

    def _awaited(self, index: int, y: int, x: int, asked: int, arrives: int) -> tuple[int, Answer]:
        for each in (index, asked):
            if not self._has(argument_checks.whole(each, "pending")):
                raise ArgumentError(f"pending: the stream has no frame {each}")
        self._check_pixel(argument_checks.whole(y, "pending"), argument_checks.whole(x, "pending"))
        return argument_checks.whole(arrives, "pending"), self._again(index, y, x, asked)

    def replay(self) -> Iterator[Answer]:
        """Yield every label of the ledger again, computed anew from the stream; equal to what was given, to the byte.

        Raises:
            ArgumentError: the stream gives another label now: it is not the one of the ledger.
        """
        for row in self.ledger:
            answer = self._again(row.frame, row.y, row.x, row.asked)
            if (answer.category, answer.instance) != (row.category, row.instance):
                raise ArgumentError(
                    f"frame {row.frame}, pixel ({row.y}, {row.x}): the ledger has {row.category!r} of instance "
                    f"{row.instance}, the stream {answer.category!r} of instance {answer.instance}"
                )
            yield answer

    def _again(self, index: int, y: int, x: int, asked: int) -> Answer:
        label = self._noisy(self._true_label(y, x, index), y, x, index, self._rules_at(asked).rules)
        return Answer(**vars(label), frame=index, pixel=(y, x), asked=asked)


def _interval(value: Any, name: str) -> tuple[int, int]:
    """Return `value` as the first frame of an interval and the first one after it."""
    pair = tuple(value) if isinstance(value, Iterable) else ()
    if len(pair) != 2:
        raise ArgumentTypeError(f"{name}={value!r}: must be two frames, the first one and the first one after")
    first, end = (argument_checks.whole(frame, name) for frame in pair)
    if not 0 <= first < end:
        raise ArgumentError(f"{name}={value!r}: must be two frames with 0 <= first < first after")
    return first, end


def _counts(pairs: Iterable[tuple[Any, Any]], name: str) -> dict[Any, int]:
    """Return pairs of a key and a count as a dict."""
    return {key: argument_checks.integer(count, name, 0) for key, count in pairs}


def _text(value: Any) -> str:
    """Return a rule as text that is the same in every process."""
    return type(value).__qualname__ if isinstance(value, Policy) and not is_dataclass(value) else repr(value)
