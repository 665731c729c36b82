# SPDX-License-Identifier: Apache-2.0
"""Timings: which bodies move when. `AllTogether`, `WaitUntilComplete` and `DictTimings`; `AssignedWindows` for subsets.

A timing assigns each body a window of time in which its clock runs (`dynamics.clocks`). It considers all bodies
together; their lifespans do not shift the windows.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from numbers import Integral

from dynamics.argument_checks import flag, not_negative, positive, set_checked
from dynamics.clocks import Window, exact
from dynamics.dynamic import Dynamic
from dynamics.errors import ArgumentError, ArgumentTypeError

NEVER = Window(Fraction(0), Fraction(0))
LONGEST_LOOP = 1e6  # s: a loop that WaitUntilComplete waits for
ALWAYS = Window(Fraction(0))


class Timing(ABC):
    """Interface of timings: when each body's clock runs."""

    @abstractmethod
    def windows(self, bodies: Sequence[tuple[str, Dynamic]]) -> list[Window]:
        """Return one window for each body.

        Args:
            bodies: Name and dynamic of each body.

        Raises:
            ArgumentError: If the timing cannot apply to these bodies.
        """


@dataclass(frozen=True)
class AllTogether(Timing):
    """All bodies start together and never stop.

    Args:
        wait_time: Seconds before they start.
    """

    wait_time: float = 1.0

    def __post_init__(self) -> None:
        set_checked(self, wait_time=not_negative)

    def windows(self, bodies: Sequence[tuple[str, Dynamic]]) -> list[Window]:
        return [Window(exact(self.wait_time))] * len(bodies)


@dataclass(frozen=True)
class WaitUntilComplete(Timing):
    """One body at a time: wait, body 0 completes one loop and stays at its start pose, wait, body 1, and so on.

    Static bodies get no turn. Dynamics whose loop never completes, or takes more than 10^6 s, are refused.

    Args:
        wait_time: Seconds before each turn.
        repeat: Start again with the first body after the last; otherwise all bodies then stay at rest.
    """

    wait_time: float
    repeat: bool = True

    def __post_init__(self) -> None:
        set_checked(self, wait_time=not_negative, repeat=flag)

    def windows(self, bodies: Sequence[tuple[str, Dynamic]]) -> list[Window]:
        turns = []
        end = Fraction(0)
        for name, dynamic in bodies:
            if math.isinf(dynamic.loop_time):
                raise ArgumentError(
                    f"WaitUntilComplete waits for each loop to end, but the {type(dynamic).__name__} of {name!r} never "
                    "returns to its start; use AllTogether or DictTimings"
                )
            if dynamic.loop_time > LONGEST_LOOP:
                raise ArgumentError(
                    f"WaitUntilComplete waits for each loop to end, but the {type(dynamic).__name__} of {name!r} takes "
                    f"{dynamic.loop_time:.3g} s: give its parts periods with a short common multiple, or use "
                    "AllTogether or DictTimings"
                )
            loop = exact(dynamic.loop_time)
            start = end + exact(self.wait_time) if loop else end
            end = start + loop
            turns.append((start, loop))
        cycle = end if self.repeat and end else None
        return [Window(start, loop, cycle) if loop else NEVER for start, loop in turns]


@dataclass(frozen=True)
class DictTimings(Timing):
    """One body at a time, each for a given time; it pauses and continues from there at its next turn.

    Bodies that are not named never move.

    Args:
        times: Body (index or name) to seconds, in the order of the turns: a mapping or pairs. Kept as a tuple of pairs.
        repeat: Start again with the first turn after the last; otherwise all bodies then stay at rest.
    """

    times: Mapping[int | str, float] | Iterable[tuple[int | str, float]]
    repeat: bool = True

    def __post_init__(self) -> None:
        given = self.times.items() if isinstance(self.times, Mapping) else self.times
        if isinstance(given, str) or not isinstance(given, Iterable):
            raise ArgumentTypeError(f"times={self.times!r}: must map bodies (index or name) to seconds")
        pairs = []
        for pair in given:
            if not isinstance(pair, Sequence) or isinstance(pair, str) or len(pair) != 2:
                raise ArgumentTypeError(f"times: {pair!r} must be a pair (index or name of a body, seconds)")
            key, seconds = pair
            if isinstance(key, bool) or not isinstance(key, Integral | str):
                raise ArgumentTypeError(f"times: {key!r} must be the index or the name of a body")
            pairs.append((key if isinstance(key, str) else int(key), positive(seconds, f"times[{key!r}]")))
        if not pairs:
            raise ArgumentError("times: must name one body or more")
        flag(self.repeat, "repeat")
        object.__setattr__(self, "times", tuple(pairs))

    def windows(self, bodies: Sequence[tuple[str, Dynamic]]) -> list[Window]:
        rows = {name: row for row, (name, _) in enumerate(bodies)}
        turns: dict[int, tuple[Fraction, Fraction]] = {}
        end = Fraction(0)
        for key, seconds in self._pairs():
            row = rows.get(key, -1) if isinstance(key, str) else key
            if not 0 <= row < len(bodies):
                known = ", ".join(repr(name) for name, _ in bodies[:20]) or "none"
                raise ArgumentError(f"DictTimings: no body {key!r}; bodies 0 to {len(bodies) - 1} are: {known}")
            if row in turns:
                raise ArgumentError(f"DictTimings: body {row} ({bodies[row][0]!r}) has two turns; name it once")
            turns[row] = (end, exact(seconds))
            end += exact(seconds)
        cycle = end if self.repeat else None
        return [Window(*turns[row], cycle) if row in turns else NEVER for row in range(len(bodies))]

    def _pairs(self) -> tuple[tuple[int | str, float], ...]:
        return tuple(self.times)  # type: ignore[arg-type]


class AssignedWindows:
    """The windows that a timing assigns to a group of bodies, for simulations of some of them.

    Timings consider all bodies together. These windows stay the same whichever bodies are simulated.
    """

    def __init__(self, timing: Timing, bodies: Sequence[tuple[str, Dynamic]]) -> None:
        """Assign the windows.

        Args:
            timing: The timing.
            bodies: Name and dynamic of each body of the group; names must differ.

        Raises:
            ArgumentError: If the timing cannot apply to these bodies.
        """
        self._by_name = dict(zip((name for name, _ in bodies), timing.windows(bodies), strict=True))

    def windows(self, bodies: Sequence[tuple[str, Dynamic]]) -> list[Window]:
        """Return the windows of some bodies of the group."""
        return [self._by_name[name] for name, _ in bodies]


# SAILenv's names.
AllTogetherTimings = AllTogether
WaitUntilCompleteTimings = WaitUntilComplete
