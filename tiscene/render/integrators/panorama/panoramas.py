# SPDX-License-Identifier: Apache-2.0
"""The panoramas of a scene, in memory and on disk."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.render.integrators.incremental.base_image import ProgressCallback, under_each_group
from tiscene.render.integrators.incremental.base_image_cache import BaseImageCache, digest_of
from tiscene.render.integrators.panorama import light_probe
from tiscene.render.integrators.panorama.anchors import Anchors
from tiscene.render.integrators.panorama.cell_files import CellFiles
from tiscene.render.integrators.panorama.light_probes import LightProbes
from tiscene.render.integrators.panorama.packed_cells import FORMAT
from tiscene.render.integrators.panorama.panorama import DIM, FIRST_DIVISOR, LEAST_SPP, Panorama, PanoramaSettings
from tiscene.render.integrators.panorama.panorama_kernels import DISTANCE_RANGE, NORMAL_RANGE
from tiscene.render.integrators.panorama.reprojection import Reprojection
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.view import CubeView, View
from tiscene.scene.placement import CURRENT, Placement


class Panoramas:
    """Panoramas by their points, settings and contents. Iterates over those in memory, least recently used first.

    Args:
        paths: Path tracer of cells.
        anchors: The points of cameras that walk.
        images: Disk cache of base images, in whose folder cells are kept too; None: none.
        memory_limit: Limit of the memory of all panoramas, bytes. One view's cells are kept even if they exceed it.
        progress: Called with the name of a stage and its completed fraction, 0..1.
    """

    def __init__(
        self,
        paths: PathPass,
        anchors: Anchors,
        images: BaseImageCache | None,
        memory_limit: int,
        progress: ProgressCallback,
    ) -> None:
        self._paths, self._anchors, self._images = paths, anchors, images
        self._memory_limit, self._progress = memory_limit, progress
        self._files = CellFiles(images.folder) if images else None
        self._probes = LightProbes(paths, self._files)
        self._panoramas: dict[tuple[Any, ...], Panorama] = {}  # least recently used first

    def __len__(self) -> int:
        return len(self._panoramas)

    def __iter__(self) -> Iterator[Panorama]:
        return iter(list(self._panoramas.values()))

    def images(
        self,
        view: View,
        static: Placement,
        settings: PanoramaSettings,
        contents: tuple[Any, ...],
        points: Reprojection | None,
    ) -> tuple[Panorama, tuple[NDArray[np.float32], NDArray[np.int32]]]:
        """Return the panorama of a view, and its `Panorama.images`. Completing it changes what the scene has placed.

        Args:
            view: Camera and image size.
            static: Placement of the static scene.
            settings: Those of the panorama.
            contents: What distinguishes the static scene from others here.
            points: What the view shows, where the panorama is that of an anchor; None: it is around the camera.
        """
        key = settings, *contents
        panorama = self._panoramas.pop(key, None)
        if panorama is None:
            panorama = self._new(view, static, settings, contents, is_anchor=points is not None)
        images = panorama.images(view, points)
        if images is None:
            missing = panorama.missing(view, points)
            while self._panoramas and self._bytes() + panorama.bytes_with(missing) > self._memory_limit:
                del self._panoramas[next(iter(self._panoramas))]
            if panorama.bytes_with(missing) > self._memory_limit:
                panorama.clear()
                missing = panorama.missing(view, points)
            panorama.complete(missing, view, static, self._progress)
            images = panorama.images(view, points)
            assert images is not None, "complete() adds all that is missing"
        self._panoramas[key] = panorama
        return panorama, images

    def _new(
        self, view: View, static: Placement, settings: PanoramaSettings, contents: tuple[Any, ...], *, is_anchor: bool
    ) -> Panorama:
        """Return a panorama, with what is on disk of it. Changes what the scene has placed."""
        self._paths.scene.place(static)
        center = self._anchors.center_of_probe(settings.center) if is_anchor else settings.center
        described = f"radiosity {light_probe.SIZE} {light_probe.PIXELS} {settings.probe_sampling}"
        statics = under_each_group(static)
        probe = self._probes.at(
            center, statics, settings.probe_sampling, contents=contents,
            file_key=lambda: self._file_key(view, static, CubeView(center, light_probe.PIXELS), {"probe": described}),
        )  # fmt: skip
        values = {
            "panorama": repr(settings),
            "cell": f"{FORMAT} {NORMAL_RANGE} {DISTANCE_RANGE}",
            "sampling": f"{FIRST_DIVISOR} {LEAST_SPP} {settings.contrast} {DIM}",
            "probe": f"{described} {center}",
            "denoiser": f"{settings.denoiser} {version('pyoidn')}",
        }
        key = self._file_key(view, static, settings.cells_view(), values)
        return Panorama(self._paths, len(statics), settings, probe, self._files, key)

    def _file_key(self, view: View, static: Placement, cells: CubeView, values: dict[str, str]) -> str:
        """Return the name of the files of cells around a point. Changes what the scene has placed."""
        if self._images is None:
            return ""
        scene = self._paths.scene
        scene.place(static)
        groups = static.light_groups
        settings: dict[str, int | str] = {
            **values,
            "background": repr(view.background),
            "coverage": int(scene.materials.any_coverage),
            "emission": int(scene.materials.any_emission),
            "groups": "" if groups is None else digest_of([groups.lights, groups.group]).hex(),
        }
        return self._images.key(scene, static.present[CURRENT], cells, settings)

    def _bytes(self) -> int:
        return sum(panorama.bytes for panorama in self._panoramas.values())
