# SPDX-License-Identifier: Apache-2.0
"""Pairs of rigid bodies and other things that do not collide with each other, as UsdPhysics' filteredPairs."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

from dynamics import RigidBody
from tiscene.errors import ScenarioError, did_you_mean
from tiscene.scenario.objects import Object

Pair = tuple[str, str]


def check_filtered_pairs(value: Any, objects: Collection[Object]) -> tuple[Pair, ...]:
    """Return pairs of names as a sorted tuple, each pair once.

    Args:
        value: a sequence of pairs: ids of objects, or an id and the path of a prim of the stage.
        objects: the objects that they may name.

    Raises:
        ScenarioError: a pair is none of two names, or names an object that does not exist, or no rigid body.
    """
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise ScenarioError(f"filtered_pairs={value!r}: must be a sequence of pairs of ids")
    rigid = {each.id: isinstance(each.dynamic, RigidBody) for each in objects}
    found = set()
    for row, pair in enumerate(value):
        name = f"filtered_pairs[{row}]={pair!r}"
        is_pair = isinstance(pair, Sequence) and not isinstance(pair, str) and len(pair) == 2
        if not is_pair or not all(isinstance(each, str) for each in pair):
            raise ScenarioError(
                f'{name}: must be two ids of objects, or an id and a prim path, as ("ball", "/Room/Net")'
            )
        for each in pair:
            if each not in rigid and not each.startswith("/"):
                raise ScenarioError(f"{name}: there is no object {each!r}{did_you_mean(each, rigid)}")
        if not any(rigid.get(each) for each in pair):
            raise ScenarioError(
                f"{name}: neither is a rigid body; give one of them dynamic=RigidBody(), or the scenario physics=True"
            )
        one, other = sorted(pair)
        if one == other:
            raise ScenarioError(f"{name}: an object does not collide with itself")
        found.add((one, other))
    return tuple(sorted(found))
