# SPDX-License-Identifier: Apache-2.0
"""Classes of SAILenv's recordings: 0, 1, ... for the chosen categories, and the number after them for all else.

The programs of SAILenv's laboratory count on this: a class for each pixel, and "background" as the last one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiscene import catalog
from tiscene.errors import ArgumentError, UnknownName

BACKGROUND = "background"


@dataclass(frozen=True)
class RecordedClasses:
    """The classes of a recording.

    Attributes:
        names: Categories in the order of their classes; all others belong to the background.
    """

    names: tuple[str, ...]

    @classmethod
    def chosen(cls, names: Sequence[str] | None, known: Sequence[str] = ()) -> RecordedClasses:
        """Return the classes of chosen categories.

        Args:
            names: The categories; None for all of the catalog, in the order of their ids.
            known: Categories that may be chosen in addition to those of the catalog.

        Raises:
            ArgumentError: A name is repeated, or is "background".
            UnknownName: A category does not exist.
        """
        if names is None:
            return cls(tuple(catalog.categories()))
        for row, name in enumerate(names):
            if name == BACKGROUND or name in names[:row]:
                raise ArgumentError(f"classes: {name!r} is the last class by itself, or is repeated")
            everything = [*catalog.categories(), *known]
            if name not in everything:
                raise UnknownName("category", name, everything)
        return cls(tuple(names))

    @classmethod
    def of_ids(cls, categories: Mapping[int, str]) -> RecordedClasses:
        """Return the classes of a stream: its selected categories, or all of the catalog.

        Args:
            categories: Names by the ids in `semantic`.
        """
        registered = catalog.categories()
        own = {name: number for number, name in sorted(categories.items()) if number}
        first_new = catalog.FIRST_UNREGISTERED_ID
        is_selection = any(number != registered.get(name, max(number, first_new)) for name, number in own.items())
        return cls(tuple(own) if is_selection else tuple(registered))

    @property
    def background(self) -> int:
        """The class of all else."""
        return len(self.names)

    @property
    def numbers(self) -> dict[str, int]:
        """The class of each category by name, with that of the background."""
        return {name: number for number, name in enumerate((*self.names, BACKGROUND))}

    def table(self, categories: Mapping[int, str], size: int = 0) -> NDArray[np.int32]:
        """Return the class of each id, int32 [at least size].

        Args:
            categories: Names by id. Other ids belong to the background.
            size: Least number of rows.
        """
        table = np.full(max([size - 1, *categories]) + 1, self.background, np.int32)
        numbers = self.numbers
        for number, name in categories.items():
            table[number] = numbers.get(name, self.background)
        return table
