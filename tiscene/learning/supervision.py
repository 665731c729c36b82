# SPDX-License-Identifier: Apache-2.0
"""Supervision: a teacher that labels single pixels of a stream, on request or unasked, within a budget.

A label of a pixel costs one ray, or nothing if the frame's labels were rendered. What a teacher answers depends only on
its rules, the stream and what it was asked before: noise is drawn by (seed, frame, pixel).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dynamics import argument_checks
from tiscene.errors import ArgumentError, ArgumentTypeError
from tiscene.frame.frame import Frame
from tiscene.learning.label_ledger import LabelLedger, LedgerRow
from tiscene.learning.pixel_labels import PixelLabel, has_labels, label_in_frame, moving_instances, render_label
from tiscene.learning.teaching_policies import Asked, Moment, Pixel, Policy, check_policy
from tiscene.stream.stream import Stream

VERSION = 1
_NOISE, _POLICY = 0x401, 0x402  # keys of random numbers


@dataclass(frozen=True)
class SupervisionRules:
    """What a teacher may say.

    Attributes:
        policy: which pixels it labels unasked, and when it is silent.
        budget: number of labels that it gives in all; None: unlimited.
        rate: labels per frame, which accumulate while they are not used: at frame k of the phase at most rate * (k + 1)
            labels have been given. None: unlimited.
        per_category: number of labels per category, 0 for the background included; None: unlimited.
        every: least number of frames from one frame with labels to the next.
        delay: number of frames until a label arrives.
        within: how far from the present frame a label may be asked for, frames; None: any distance.
        noise: fraction of labels whose category is replaced by another one of the stream, 0..1.
        seed: of the policy's and the noise's random numbers.

    Raises:
        ArgumentError: a value is out of range.
    """

    policy: Policy = field(default_factory=Asked)
    budget: int | None = None
    rate: float | None = None
    per_category: int | None = None
    every: int = 1
    delay: int = 0
    within: int | None = None
    noise: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        check_policy(self.policy, "policy")
        for name, low in (("budget", 0), ("per_category", 0), ("within", 0), ("every", 1), ("delay", 0), ("seed", 0)):
            value = getattr(self, name)
            if value is not None or name not in ("budget", "per_category", "within"):
                argument_checks.integer(value, name, low)
        if self.rate is not None:
            argument_checks.not_negative(self.rate, "rate")
        if not 0.0 <= argument_checks.number(self.noise, "noise") <= 1.0:
            raise ArgumentError(f"noise={self.noise!r}: must be a fraction from 0 to 1")


@dataclass(frozen=True)
class Answer(PixelLabel):
    """A label that the learner has received.

    Attributes:
        frame: index of the frame that it is of.
        pixel: row and column.
        asked: index of the frame at which it was asked for or offered.
    """

    frame: int = 0
    pixel: Pixel = (0, 0)
    asked: int = 0


@dataclass(frozen=True)
class Pending:
    """A label that arrives later; `Supervision.arrived` returns it then.

    Attributes:
        frame: index of the frame that it is of.
        pixel: row and column.
        arrives: index of the frame at which it arrives.
    """

    frame: int
    pixel: Pixel
    arrives: int


@dataclass(frozen=True)
class Refused:
    """A question without an answer. It is false, so that `if answer:` tells both apart.

    Attributes:
        reason: "budget", "rate", "category budget", "too soon", "silent", "too far" or "no such frame".
    """

    reason: str

    def __bool__(self) -> bool:
        return False


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
        stream: Any,
        *,
        policy: Policy | None = None,
        silent: Sequence[tuple[int, int]] = (),
        **rules: Any,
    ) -> None:
        self._stream = stream
        given = rules | ({} if policy is None else {"policy": policy})
        argument_checks.known_names(given, (*SupervisionRules.__dataclass_fields__, "silent"), "Supervision")
        self._rules = SupervisionRules(**given) if given or not hasattr(stream, "rules") else None
        self._silent = tuple(_interval(each, f"silent[{row}]") for row, each in enumerate(silent))
        self._held: Frame | None = None
        self._held_position = 0
        self._moving: tuple[int, frozenset[int]] = -1, frozenset()
        self._clear()

    def _clear(self) -> None:
        self.ledger = LabelLedger()
        self.refused: Counter[str] = Counter()
        self._given: Counter[int] = Counter()  # labels by phase
        self._by_category: Counter[tuple[int, int]] = Counter()  # by phase and true category
        self._last: dict[int, int] = {}  # the last frame with labels, by phase
        self._pending: list[tuple[int, Answer]] = []

    @property
    def remaining(self) -> float:
        """Labels left of the budget of the present phase; infinity without one. `rate` is not counted."""
        phase, rules, _, _ = self._rules_at(self.present)
        return math.inf if rules is None or rules.budget is None else rules.budget - self._given[phase]

    @property
    def present(self) -> int:
        """The index of the frame that the learner holds: the last one offered or returned by the stream."""
        if self._held is not None and self._held_position == self._stream.position:
            return self._held.index
        return max(int(self._stream.position) - 1, 0)

    def hold(self, frame: Frame) -> None:
        """Make a frame the present one. `offers` does this as well."""
        self._held, self._held_position = frame, self._stream.position

    def ask(self, y: int, x: int, frame: Frame | int | None = None) -> Answer | Pending | Refused:
        """Ask for the label of a pixel.

        Args:
            y: row, px.
            x: column, px.
            frame: the frame or its index, past or future; None: the present one. A frame that has the buffers
                semantic, instance, part and depth is read; else the label costs one ray.

        Returns:
            The answer; a Pending if answers are delayed; a Refused if there is none.

        Raises:
            ArgumentError: the pixel is outside the image, or a number is not whole.
        """
        if isinstance(frame, Frame):
            self.hold(frame)
        row, column = argument_checks.whole(y, "y"), argument_checks.whole(x, "x")
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
        _, rules, _, _ = self._rules_at(frame.index)
        moment = self._moment(frame.index)
        if rules is None or self._is_silent(frame.index, rules, moment):
            return
        for y, x in rules.policy.pixels(frame, moment):
            answer = self._label(int(y), int(x), frame.index, unasked=True)
            if not isinstance(answer, Refused):
                yield (int(y), int(x)), answer

    def arrived(self, index: int) -> list[Answer]:
        """Return the delayed answers that arrive at a frame, or have arrived since the last call."""
        due = [answer for arrives, answer in self._pending if arrives <= index]
        self._pending = [(arrives, answer) for arrives, answer in self._pending if arrives > index]
        return due

    def _rules_at(self, index: int) -> tuple[int, SupervisionRules | None, int, int | None]:
        """Return the number of the phase, its rules, the frame's number in it, and its length."""
        if self._rules is None:
            result: tuple[int, SupervisionRules | None, int, int | None] = self._stream.rules(index)
            return result
        length = len(self._stream) if hasattr(self._stream, "rules") else self._stream.frames
        return 0, self._rules, index, length

    def _source(self, index: int) -> tuple[Stream, int]:
        if hasattr(self._stream, "source"):
            source: tuple[Stream, int] = self._stream.source(index)
            return source
        return self._stream, index

    def _moment(self, index: int) -> Moment:
        phase, rules, number, length = self._rules_at(index)
        rng = np.random.default_rng((_POLICY, rules.seed if rules else 0, phase, index))
        return Moment(number, length, rng, self._moving_at(index))

    def _moving_at(self, index: int) -> frozenset[int]:
        held = self._held
        if held is not None and held.index == index and hasattr(held, "moving"):
            return frozenset(held.moving)  # a frame of a course knows it
        if self._moving[0] != index:
            source, k = self._source(index)
            self._moving = index, frozenset(moving_instances(source.world.state(k)))
        return self._moving[1]

    def _is_silent(self, index: int, rules: SupervisionRules, moment: Moment) -> bool:
        return any(first <= index < end for first, end in self._silent) or rules.policy.is_silent(moment)

    def _label(self, y: int, x: int, index: int, unasked: bool) -> Answer | Pending | Refused:
        if not (0 <= y < self._stream.height and 0 <= x < self._stream.width):
            raise ArgumentError(f"pixel ({y}, {x}): the image is {self._stream.height} x {self._stream.width} px")
        phase, rules, number, _ = self._rules_at(self.present)
        reason = self._refusal(phase, rules, number, index)
        label = None if reason else self._true_label(y, x, index)
        if label is not None and rules is not None and rules.per_category is not None:
            if self._by_category[phase, label.category_id] >= rules.per_category:
                reason = "category budget"
        if reason or label is None or rules is None:
            self.refused[reason] += 1
            return Refused(reason)
        self._given[phase] += 1
        self._by_category[phase, label.category_id] += 1
        self._last[phase] = number
        label = self._noisy(label, y, x, index, rules)
        answer = Answer(**vars(label), frame=index, pixel=(y, x), asked=self.present)
        arrives = self.present + rules.delay
        self.ledger.add(LedgerRow(self.present, index, y, x, answer.category, answer.instance, arrives, unasked))
        if not rules.delay:
            return answer
        self._pending.append((arrives, answer))
        return Pending(index, (y, x), arrives)

    def _refusal(self, phase: int, rules: SupervisionRules | None, number: int, index: int) -> str:
        """Return why a question is refused before its label is known; "" if it is not."""
        if rules is None or self._is_silent(self.present, rules, self._moment(self.present)):
            return "silent"
        if index < 0 or (_length(self._stream) is not None and index >= (_length(self._stream) or 0)):
            return "no such frame"
        if rules.within is not None and abs(index - self.present) > rules.within:
            return "too far"
        if rules.budget is not None and self._given[phase] >= rules.budget:
            return "budget"
        if rules.rate is not None and self._given[phase] + 1 > rules.rate * (number + 1) + 1e-9:
            return "rate"
        last = self._last.get(phase)
        return "too soon" if last is not None and 0 < number - last < rules.every else ""

    def _true_label(self, y: int, x: int, index: int) -> PixelLabel:
        source, k = self._source(index)
        held = self._held
        if held is not None and held.index == index == self.present and has_labels(held):
            return label_in_frame(held, y, x, int(held.instance[y, x]) in self._moving_at(index))
        return render_label(source, k, y, x)

    def _noisy(self, label: PixelLabel, y: int, x: int, index: int, rules: SupervisionRules) -> PixelLabel:
        """Replace the category of a fraction of the labels by another one, drawn by frame and pixel."""
        rng = np.random.default_rng((_NOISE, rules.seed, index, y, x))
        if rng.random() >= rules.noise:
            return label
        others = [number for number in sorted(self._stream.categories) if number not in (0, label.category_id)]
        if not others:
            return label
        number = others[int(rng.integers(len(others)))]
        return replace(label, category_id=number, category=self._stream.categories[number])

    def state_dict(self) -> dict[str, Any]:
        """Return the ledger, the counts and the pending answers as JSON-ready values."""
        return {
            "version": VERSION,
            "ledger": self.ledger.to_json(),
            "refused": dict(self.refused),
            "given": [[phase, count] for phase, count in self._given.items()],
            "by_category": [[*key, count] for key, count in self._by_category.items()],
            "last": [[phase, number] for phase, number in self._last.items()],
            "pending": [[answer.frame, *answer.pixel, answer.asked, arrives] for arrives, answer in self._pending],
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue where `state_dict` was taken, with the same rules on the same stream.

        Raises:
            ArgumentError: this is not such a state.
        """
        if not isinstance(state, Mapping) or state.get("version") != VERSION:
            raise ArgumentError(f"this is not a Supervision.state_dict of version {VERSION}")
        ledger = LabelLedger(state["ledger"])
        self._clear()
        self._held = None
        self.ledger = ledger
        self.refused.update(state["refused"])
        self._given.update(dict(state["given"]))
        self._by_category.update({(phase, number): count for phase, number, count in state["by_category"]})
        self._last.update(dict(state["last"]))
        self._pending = [(arrives, self._again(index, y, x, asked)) for index, y, x, asked, arrives in state["pending"]]

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
        _, rules, _, _ = self._rules_at(asked)
        label = self._true_label(y, x, index)
        if rules is not None:
            label = self._noisy(label, y, x, index, rules)
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


def _length(stream: Any) -> int | None:
    return len(stream) if hasattr(stream, "rules") else stream.frames
