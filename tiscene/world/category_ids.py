# SPDX-License-Identifier: Apache-2.0
"""CategoryIds: ids of semantic categories, the values of the `semantic` buffer.

Registered categories have the same id in every scene. Others are numbered in the order in which they first appear among
the objects of the stage, its templates and the scenario's objects, so that all scenarios in one scene agree. A
selection numbers its own categories 1 to n instead, and gives all others the id 0 of the background.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping

from tiscene.errors import StageWarning, did_you_mean


class CategoryIds:
    """Ids of categories, assigned at first use.

    Args:
        registered: ids by name, 1 or more.
        first_new: id of the first category that is not registered.
        selected: categories that get the ids 1, 2, ... in this order, whatever is registered; all others get 0. None:
            no selection.

    Attributes:
        names: names by id; 0 is "". Without a selection, it has the categories that were looked up so far.
    """

    def __init__(
        self, registered: Mapping[str, int] | None = None, first_new: int = 1, selected: Iterable[str] | None = None
    ) -> None:
        self._registered = registered or {}
        self._selected = None if selected is None else {name: number for number, name in enumerate(selected, 1)}
        self._next = first_new
        self._ids = {"": 0}
        self.names = {0: "", **{number: name for name, number in (self._selected or {}).items()}}

    def of(self, category: str) -> int:
        """Return the id of a category; a new one gets an id. "" has 0."""
        if category not in self._ids:
            self._ids[category] = self._new_id(category)
        return self._ids[category]

    def _new_id(self, category: str) -> int:
        if self._selected is not None:
            return self._selected.get(category, 0)
        number = self._registered.get(category, self._next)
        self._next += category not in self._registered
        self.names[number] = category
        return number

    def warn_of_absent(self, others: Iterable[str] = ()) -> None:
        """Warn of selected categories that are not registered, have not been looked up, and are not among `others`.

        That is no error: other scenes, or objects that are spawned later, may have them.

        Args:
            others: further known categories; read only if needed.
        """
        present = {*self._registered, *self._ids}
        missing = [name for name in self._selected or () if name not in present]
        known = {*present, *others} - {""} if missing else present
        absent = [f"{name!r}{did_you_mean(name, known)}" for name in missing if name not in known]
        if absent:
            hint = "`tiscene list --json` lists those of all shipped scenes, `stream.categories` those of a scene"
            text = f"categories: nothing here is {', '.join(absent)}: ids that no pixel has so far ({hint})"
            warnings.warn(StageWarning(text), stacklevel=3)
