# SPDX-License-Identifier: Apache-2.0
"""Poses of a glTF 2.0 scene: transforms of its nodes and weights of its morph targets, at rest or at a time.

`AnimationSampler` evaluates the first animation of a file, by linear, step and cubic spline interpolation as the
specification defines them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics.rotation import matrix_from_quaternion
from tiscene.usd.importers.gltf import GltfDocument

Floats = NDArray[np.float64]

FRAME_RATE = 30  # samples a second
MAX_FRAMES = 3000  # longer animations are cut
_PATHS = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}


@dataclass(frozen=True, eq=False)
class ScenePose:
    """World transforms of all nodes [n, 4, 4], and the weights of the morph targets of each."""

    worlds: Floats
    weights: Mapping[int, Floats]


class AnimationSampler:
    """Evaluates the poses of a file.

    Attributes:
        times: the frames of the first animation, s; empty if nothing moves.
        order: nodes of the scene, parents first, as (node, parent); the parent of a root is -1.
    """

    def __init__(self, document: GltfDocument) -> None:
        self._document = document
        self._nodes = document.listed("nodes")
        self.order = self._scene_nodes()
        self._channels: list[tuple[int, str, Floats, Floats, str]] = []
        for animation in document.listed("animations")[:1]:
            for channel in animation["channels"]:
                self._add(channel["target"], animation["samplers"][channel["sampler"]])
        end = max((float(times[-1]) for _, _, times, _, _ in self._channels), default=0.0)
        count = min(int(np.ceil(end * FRAME_RATE - 1e-6)) + 1, MAX_FRAMES)
        self.times = np.arange(count) / FRAME_RATE if end > 0.0 else np.zeros(0)

    def _add(self, target: Mapping[str, Any], sampler: Mapping[str, Any]) -> None:
        node, path = target.get("node"), str(target.get("path"))
        if node is None or path not in (*_PATHS, "weights"):
            return
        times = self._document.accessor(sampler["input"])[:, 0].astype(np.float64)
        values = self._document.accessor(sampler["output"]).astype(np.float64)
        if not len(times) or not np.isfinite(times).all() or not np.isfinite(values).all():
            raise ValueError("an animation has no keys, or keys that are not finite")
        mode = str(sampler.get("interpolation", "LINEAR"))
        shape = (len(times), 3, -1) if mode == "CUBICSPLINE" else (len(times), -1)
        self._channels.append((int(node), path, times, values.reshape(shape), mode))

    def _scene_nodes(self) -> list[tuple[int, int]]:
        """Return the nodes of the default scene, parents first; of a file without scenes, all of them."""
        scenes = self._document.listed("scenes")
        children = {int(child) for node in self._nodes for child in node.get("children", ())}
        roots = [row for row in range(len(self._nodes)) if row not in children]
        if scenes:
            roots = [int(each) for each in scenes[int(self._document.header.get("scene", 0))].get("nodes", ())]
        found: list[tuple[int, int]] = []
        pending = [(root, -1) for root in reversed(roots)]
        seen: set[int] = set()
        while pending:
            node, parent = pending.pop()
            if node in seen:
                raise ValueError(f"node {node} has several parents or is a part of itself")
            seen.add(node)
            found.append((node, parent))
            pending += [(int(each), node) for each in reversed(self._nodes[node].get("children", ()))]
        return found

    def pose(self, time: float | None = None) -> ScenePose:
        """Return the pose at a time, s; None: at rest."""
        parts: dict[tuple[int, str], Floats] = {}
        for node, path, times, values, mode in self._channels if time is not None else ():
            parts[node, path] = _interpolated(time or 0.0, times, values, mode, path == "rotation")
        worlds = np.tile(np.eye(4), (len(self._nodes), 1, 1))
        for node, parent in self.order:
            local = self._local(node, parts)
            worlds[node] = local if parent < 0 else worlds[parent] @ local
        weights = {node: values for (node, path), values in parts.items() if path == "weights"}
        return ScenePose(worlds, weights)

    def _local(self, node: int, parts: Mapping[tuple[int, str], Floats]) -> Floats:
        entry = self._nodes[node]
        if "matrix" in entry and not any((node, path) in parts for path in _PATHS):
            return np.asarray(entry["matrix"], np.float64).reshape(4, 4).T
        translation, rotation, scale = (
            np.asarray(parts.get((node, path), entry.get(path, default)), np.float64)
            for path, default in _PATHS.items()
        )
        x, y, z, w = rotation / max(float(np.linalg.norm(rotation)), 1e-12)
        matrix = np.eye(4)
        matrix[:3, :3] = matrix_from_quaternion((w, x, y, z)) * scale
        matrix[:3, 3] = translation
        return matrix


def _interpolated(time: float, times: Floats, values: Floats, mode: str, is_rotation: bool) -> Floats:
    """Return the value of a channel at a time; before the first key and after the last one it stays."""
    keys = values[:, 1] if mode == "CUBICSPLINE" else values
    row = int(np.clip(np.searchsorted(times, time, side="right") - 1, 0, max(len(times) - 2, 0)))
    if len(times) == 1 or time <= times[0]:
        return np.asarray(keys[0])
    if time >= times[-1]:
        return np.asarray(keys[-1])
    span = times[row + 1] - times[row]
    t = (time - times[row]) / span if span > 0.0 else 0.0
    first, second = keys[row], keys[row + 1]
    if mode == "STEP":
        return np.asarray(first)
    if mode == "CUBICSPLINE":
        out_tangent, in_tangent = span * values[row, 2], span * values[row + 1, 0]
        a, b = 2 * t**3 - 3 * t**2 + 1, t**3 - 2 * t**2 + t
        return np.asarray(a * first + b * out_tangent + (1 - a) * second + (t**3 - t**2) * in_tangent)
    if not is_rotation:
        return np.asarray(first + (second - first) * t)
    cosine = float(first @ second)
    if cosine < 0.0:
        second, cosine = -second, -cosine
    if cosine > 0.9995:
        return np.asarray(first + (second - first) * t)
    angle = np.arccos(cosine)
    return np.asarray((np.sin((1.0 - t) * angle) * first + np.sin(t * angle) * second) / np.sin(angle))
