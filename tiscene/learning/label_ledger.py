# SPDX-License-Identifier: Apache-2.0
"""LabelLedger: every label that a teacher has given, in columns, as part of saved states."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from dynamics import argument_checks
from tiscene.errors import ArgumentError


class LedgerRow(NamedTuple):
    """One label that was given.

    Attributes:
        asked: frame at which it was given or asked for.
        frame: frame that it is of.
        y: row of the pixel.
        x: column of the pixel.
        category: category as it was said, which noise may have changed.
        instance: instance id.
        delivered: frame at which the learner receives it.
        unasked: whether the teacher offered it.
    """

    asked: int
    frame: int
    y: int
    x: int
    category: str
    instance: int
    delivered: int
    unasked: bool


class LabelLedger(list[LedgerRow]):
    """The labels that were given, in their order.

    Args:
        columns: of `to_json`; None: empty.

    Raises:
        ArgumentError: the columns are not those of a ledger.
    """

    def __init__(self, columns: Mapping[str, Sequence[Any]] | None = None) -> None:
        super().__init__()
        if columns is not None:
            is_mapping = isinstance(columns, Mapping) and set(columns) == set(LedgerRow._fields)
            if not is_mapping or len({len(column) for column in columns.values()}) > 1:
                names = ", ".join(LedgerRow._fields)
                raise ArgumentError(f"ledger: must have the columns {names}, all of one length")
            for name in ("asked", "frame", "y", "x", "instance", "delivered"):
                for value in columns[name]:
                    argument_checks.whole(value, f"ledger: {name}")
            self.extend(LedgerRow(*row) for row in zip(*(columns[name] for name in LedgerRow._fields), strict=True))

    def to_json(self) -> dict[str, list[Any]]:
        """Return the ledger as JSON-ready columns."""
        columns = list(zip(*self, strict=True)) or [()] * len(LedgerRow._fields)
        return {name: list(column) for name, column in zip(LedgerRow._fields, columns, strict=True)}

    def digest(self) -> str:
        """Return the SHA-256 of the ledger: equal digests mean equal labels at equal times."""
        return hashlib.sha256(json.dumps(self.to_json(), separators=(",", ":")).encode()).hexdigest()
