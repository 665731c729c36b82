# SPDX-License-Identifier: Apache-2.0
"""What a teacher says to a question: an Answer, a Pending one that arrives later, or Refused."""

from __future__ import annotations

from dataclasses import dataclass

from tiscene.learning.pixel_labels import PixelLabel
from tiscene.learning.teaching_policies import Pixel


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
