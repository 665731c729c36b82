# SPDX-License-Identifier: Apache-2.0
"""ObjectMovers: the objects of a scenario as bodies and movers of `dynamics`.

They are made when they are needed and dropped when their objects are gone: a stream that keeps spawning and despawning
objects holds as many as are alive.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import overload

import numpy as np
from numpy.typing import NDArray

from dynamics import Body, Mover, RigidBody, Shape, Still, Teleport, UniformMovementRandomBounce, cover
from dynamics.lru_cache import LRUCache
from dynamics.rotation import quaternion
from tiscene.scenario.edits import Despawn, Edit, EditLog, Move
from tiscene.scenario.objects import Object, path_of

MAX_SHAPES = 256  # sphere proxies kept
MAX_PROXIES = 1024  # kept for all worlds of this process, about 5 kB each
UNUSED = 64  # objects kept beside the used ones and as many others

_proxies: LRUCache[bytes, Shape] = LRUCache(MAX_PROXIES)  # by the digest of the surface


@dataclass(eq=False)
class _Entry:
    """An object as a body with a closed form, and as a mover if it was asked for."""

    body: Body
    mover: Mover | None = None


class ObjectMovers(Sequence[Mover]):
    """The movers of a scenario's objects, by row in `EditLog.histories`.

    Args:
        log: the edit log; `amend` takes further edits.
        fps: frames per second.
        surface: returns an object's collision surface [m, 3, 3], m.
    """

    def __init__(self, log: EditLog, fps: Fraction, surface: Callable[[Object], NDArray[np.float64]]) -> None:
        self._log = log
        self._fps = fps
        self._surface = surface
        self._entries: dict[int, _Entry] = {}
        self._shapes: LRUCache[tuple[object, ...], Shape | None] = LRUCache(MAX_SHAPES)

    def __len__(self) -> int:
        return len(self._log.histories)

    @overload
    def __getitem__(self, row: int) -> Mover: ...

    @overload
    def __getitem__(self, row: slice) -> Sequence[Mover]: ...

    def __getitem__(self, row: int | slice) -> Mover | Sequence[Mover]:
        if isinstance(row, slice):
            return [self[each] for each in range(len(self))[row]]
        entry = self._entry(range(len(self))[row])
        if entry.mover is None:
            entry.mover = self._mover(row, entry.body)
        return entry.mover

    def body(self, row: int) -> Body:
        """Return an object's body with a closed form: a bouncing one stands at its start."""
        return self._entry(row).body

    def amend(self, edit: Edit) -> None:
        """Take one more edit of the log."""
        if not isinstance(edit, Move | Despawn):
            return
        row = self._log.row(edit.id)
        entry = None if row is None else self._entries.get(row)
        if row is None or entry is None or entry.mover is None:
            return
        history, moves = self._log.histories[row], entry.mover.moves
        if isinstance(edit, Despawn):
            entry.mover = replace(entry.mover, last_frame=history.last_frame)
        elif history.moves[-1] is edit and isinstance(moves, list):
            moves.append(_teleport(edit))
        else:  # it was inserted before others
            entry.mover = None

    def keep(self, rows: Iterable[int]) -> None:
        """Drop objects that are not in `rows`, once they are the greater part."""
        used = set(rows)
        if len(self._entries) > 2 * len(used) + UNUSED:
            self._entries = {row: entry for row, entry in self._entries.items() if row in used}

    def _entry(self, row: int) -> _Entry:
        entry = self._entries.get(row)
        if entry is None:
            history = self._log.histories[row]
            spec = history.spec
            path = path_of(spec)
            dynamic = Still() if isinstance(path, UniformMovementRandomBounce) else path
            birth = Fraction(spec.first_frame) / self._fps
            body = Body(dynamic, spec.position, spec.rotation, name=spec.id, birth=birth, timed=history.spawned is None)
            entry = self._entries[row] = _Entry(body)
        return entry

    def _mover(self, row: int, body: Body) -> Mover:
        history = self._log.histories[row]
        spec = history.spec
        if isinstance(spec.dynamic, UniformMovementRandomBounce):
            body = replace(body, dynamic=spec.dynamic)
        return Mover(
            body,
            self._shape(spec) if spec.collide and not isinstance(spec.dynamic, RigidBody) else None,
            spec.frustum_limited,
            spec.first_frame,
            history.last_frame,
            [_teleport(move) for move in history.moves],
        )

    def _shape(self, spec: Object) -> Shape | None:
        """Return the proxy spheres of an object, shared by template and scale; None without a surface."""

        def new() -> Shape | None:
            surface = self._surface(spec)
            return _proxy_of(surface) if len(surface) else None

        return self._shapes.get((spec.template, spec.scale), new)


def _teleport(move: Move) -> Teleport:
    w, x, y, z = quaternion(move.rotation).tolist()
    return Teleport(move.frame, move.position, (w, x, y, z))


def _proxy_of(surface: NDArray[np.float64]) -> Shape:
    """Return `dynamics.cover` of a surface, float64 [m, 3, 3], m. Taichi must be running."""
    key = hashlib.sha256(np.ascontiguousarray(surface, np.float64).data).digest()
    return _proxies.get(key, lambda: _new_proxy(surface))


def _new_proxy(surface: NDArray[np.float64]) -> Shape:
    shape = cover(surface)
    for array in (shape.spheres, shape.groups, shape.first):
        array.setflags(write=False)
    return shape
