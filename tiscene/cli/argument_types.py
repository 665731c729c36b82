# SPDX-License-Identifier: Apache-2.0
"""Types of command-line arguments: functions from text to values, for argparse."""

from __future__ import annotations

import argparse


def frame_slice(text: str) -> slice:
    """Return the slice of "A:B", "A:B:STEP", "A:" or "K"; frame indices are 0 or more."""
    mistake = argparse.ArgumentTypeError(
        f"{text!r} is neither A:B with 0 <= A < B, such as 0:100, nor A: with --count, nor one frame K from 0 on"
    )
    try:
        numbers = [int(part) if part else None for part in text.split(":")]
        if len(numbers) == 1:
            numbers = [int(text), int(text) + 1]
        frames = slice(*numbers)
        start, stop, step = frames.start or 0, frames.stop, frames.step if frames.step is not None else 1
    except (ValueError, TypeError):
        raise mistake from None
    if start < 0 or step == 0 or (step < 0 if stop is None else len(range(start, stop, step)) == 0 or stop < 0):
        raise mistake
    return slice(start, stop, step)


def name_list(text: str) -> tuple[str, ...]:
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    if not names:
        raise argparse.ArgumentTypeError(f"{text!r} has no names; expected names separated by commas")
    return names


def path(text: str) -> str:
    """Return a path. One that is empty would stand for the present folder; it is often an unset variable of a shell."""
    if not text:
        raise argparse.ArgumentTypeError("the path is empty; . is the present folder")
    return text


def count(text: str) -> int:
    """Return a whole number from 1 on."""
    if not (text.isdecimal() and int(text) > 0):
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 1 on")
    return int(text)


def number_list(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not OPEN,CLOSE in frames, such as 0,0.5") from None


def variant_choice(text: str) -> tuple[str, str]:
    """Split "/Room02{lighting}=evening" into ("/Room02{lighting}", "evening")."""
    place, _, variant = text.partition("=")
    if not (place.startswith("/") and "{" in place and place.endswith("}") and variant):
        raise argparse.ArgumentTypeError(f"{text!r} is not PRIM{{SET}}=NAME, such as /Room02{{lighting}}=evening")
    return place, variant
