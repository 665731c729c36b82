# SPDX-License-Identifier: Apache-2.0
"""Numbers of categories in `category` views: 8 bits, 255 for no category, the same in all scenes.

A category of the catalog has its id in the catalog. Other categories, such as those of uploaded models, have the
numbers after these, as they first appear after the start of a scene.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from tiscene import catalog
from tiscene.sailenv.frame_views import NO_CATEGORY


class CategoryNumbers:
    """Numbers by category name.

    Args:
        names: Categories to begin with, in the order in which those that the catalog lacks are numbered.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._registered = {name: number for name, number in catalog.categories().items() if number < NO_CATEGORY}
        self._next = max(self._registered.values(), default=0) + 1
        self._numbers = {"": NO_CATEGORY}
        for name in names:
            self.number(name)

    def number(self, name: str) -> int:
        """Return the number of a category; NO_CATEGORY if all 8-bit numbers are taken."""
        if name not in self._numbers:
            number = self._registered.get(name)
            if number is None:
                number = min(self._next, NO_CATEGORY)
                self._next += 1
            self._numbers[name] = number
        return self._numbers[name]

    def names(self, others: Iterable[str]) -> dict[int, str]:
        """Return the names of all numbers so far and of further categories, by number."""
        for name in others:
            self.number(name)
        return {number: name for name, number in sorted(self._numbers.items()) if number != NO_CATEGORY}

    def table(self, categories: Mapping[int, str]) -> NDArray[np.uint8]:
        """Return the number of each id of `semantic`, uint8 [largest id + 1].

        Args:
            categories: Names by id.
        """
        table = np.full(max(categories) + 1, NO_CATEGORY, np.uint8)
        for semantic_id, name in sorted(categories.items()):
            table[semantic_id] = self.number(name)
        return table
