# SPDX-License-Identifier: Apache-2.0
"""The panorama pass: radiance of a frame whose camera turns or walks.

1. `PanoramaPass.prepare` resamples the light of the static scene from a panorama around the camera's center or around
   an anchor nearby, and traces a few paths through the static scene in an image of reduced size.
2. `PanoramaPass.render` traces those of them again that movers invalidate, as the incremental pass does. The mean
   change of each pixel is what movers add to or take from the light of static surfaces. What movers emit is path traced
   by itself at the same size, and added.
3. Pixels in which a mover is visible, those beside it whose light it changes much, and those that the panorama does not
   know, are path traced.

All these paths end in the panorama's light probe, where it knows a surface that they reach.

The image is approximate: resampling blurs by half a pixel, highlights are those that the anchor sees, and movers change
light farther away at a reduced size. Every frame is a function of its own inputs, not of previous frames.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.render.film.upsample import ALBEDO_OFFSET, block_means, demodulate, interpolated, upsample
from tiscene.render.integrators.incremental.base_image import (
    ProgressCallback,
    base_placement,
    no_progress,
    static_scene_key,
)
from tiscene.render.integrators.incremental.base_image_cache import BaseImageCache
from tiscene.render.integrators.incremental.mover_coverage import dilated
from tiscene.render.integrators.incremental.path_recording import AUXILIARY, light_column
from tiscene.render.integrators.incremental.retrace_kernels import MOVER_HITS
from tiscene.render.integrators.labels.first_hits import StaticHits
from tiscene.render.integrators.panorama.anchors import Anchors, walks
from tiscene.render.integrators.panorama.light_changes import REDUCTION, LightChanges, changed_beside_movers
from tiscene.render.integrators.panorama.light_probe import LightProbe
from tiscene.render.integrators.panorama.panorama import PanoramaSettings
from tiscene.render.integrators.panorama.panoramas import Panoramas
from tiscene.render.integrators.panorama.reprojection import Reprojection
from tiscene.render.integrators.panorama.reprojection_kernels import ALL_KNOWN, NONE_KNOWN, SUBPIXELS
from tiscene.render.integrators.panorama.subpixels import Hidden, SubpixelPaths
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.intersect.ray_queue import RayArrays
from tiscene.render.sampling.sobol import frame_key
from tiscene.render.view import MAX_PIXELS, View
from tiscene.scene.placement import CURRENT, Placement

FloatImage = NDArray[np.float32]

_SHARES = np.array([bits.bit_count() / SUBPIXELS for bits in range(ALL_KNOWN + 1)], np.float32)  # of known subpixels
CHANGES_DEPTH = 3  # largest number of segments of the paths that find movers' changes of light: one bounce
# Frame numbers of keys whose random numbers then vary with the frame.
CHANGES_FRAME, OPACITY_FRAME, MOVERS_FRAME, LIGHT_FRAME = -7, -8, -9, -10


@dataclass(frozen=True, eq=False)
class PanoramaImage:
    """Images of a frame over a panorama, and what its denoiser needs.

    Attributes:
        static: Radiance without the movers' changes of light on other surfaces, W/m²/sr, float32 [h, w, 3].
        albedo: As of a `PathImage`, float32 [h, w, 3].
        normal: The same.
        denoised: What the panorama knows of `static`, denoised, float32 [h, w, 3].
        hidden: What it does not know of pixels that are not `traced`.
        before: Irradiance of `static` at reduced size, float32 [h', w', 3], see `upsample.demodulate`.
        change: How the movers change it, as far as they do, float32 [h', w', 3]; None: they do not.
        after: The changed irradiance, without outliers, float32 [h', w', 3]; None if `change` is.
        emitted: Irradiance by movers that emit light, float32 [h', w', 3]; None: none does.
        white: Albedo of the irradiance, float32 [h', w', 3].
        reduced_normal: Normals at reduced size, float32 [h', w', 3].
        traced: bool [h, w], pixels that are path traced: they show movers, or what the panorama does not know, or are
            `beside` movers.
        beside: float32 [h, w], share of path-traced light in pixels beside movers, which change much of their light;
            the rest is that of the panorama, with `change`. 0 elsewhere.
        static_mask: float32 [h, w, 1], share of pixels that `denoised` knows: 0 where they are path traced alone, 1
            `beside` movers, less beside edges that hide something from the panorama's center.
        panorama_spp: Samples per pixel of the panorama.
    """

    static: FloatImage
    albedo: FloatImage
    normal: FloatImage
    denoised: FloatImage
    hidden: Hidden
    before: FloatImage
    change: FloatImage | None
    after: FloatImage | None
    emitted: FloatImage | None
    white: FloatImage
    reduced_normal: FloatImage
    traced: NDArray[np.bool_]
    beside: FloatImage
    static_mask: FloatImage
    panorama_spp: int

    @property
    def hdr(self) -> FloatImage:
        """Scene-linear radiance, W/m²/sr, float32 [h, w, 3]."""
        lit = self.normal.any(axis=-1) & (self.beside == 0.0)  # there is a surface, which is not path traced
        image, mask = self.static, self.static_mask * lit[..., None]
        for change in (self.change, self.emitted):
            if change is not None:
                image = image + mask * upsample(change, self.reduced_normal, self.albedo, self.normal, REDUCTION)
        return image


@dataclass(frozen=True, eq=False)
class _StaticImage:
    """What a view shows of the static scene.

    Attributes:
        key: What it was made for; None where the camera moves: it serves one frame.
        images: float32 [n, h, w, 3], see `Panorama.images`.
        known: int32 [h, w], likewise.
        probe: The panorama's.
        is_anchored: Whether the panorama is that of an anchor.
    """

    key: tuple[Any, ...] | None
    images: FloatImage
    known: NDArray[np.int32]
    probe: LightProbe
    is_anchored: bool

    def light(self, factors: FloatImage) -> tuple[FloatImage, FloatImage, FloatImage, FloatImage]:
        """Return radiance, the same denoised, albedo and normals, to be changed, under the lights' factors."""
        images = self.images if self.key is None else self.images.copy()
        radiance, *others = (images[light_column(group) // 3] for group in range(len(factors)))
        denoised, *others_denoised = images[-len(factors) :]
        for light, clean, factor in zip(others, others_denoised, factors[1:], strict=True):
            radiance += factor * light
            denoised += factor * clean
        return radiance, denoised, images[AUXILIARY // 3], images[AUXILIARY // 3 + 1]


@dataclass(frozen=True, eq=False)
class _Movers:
    """Where an image shows movers, and what they change.

    Attributes:
        correction: What recorded paths find that they change of radiance, float32 [h', w', 3].
        hits: bool [h', w'], recorded paths hit one first: the change is not known there.
        covered: bool [h', w'], `hits`, or labels show one.
        visible: bool [h, w], pixels that may show one.
        beside: As of a `PanoramaImage`, float32 [h, w].
    """

    correction: FloatImage
    hits: NDArray[np.bool_]
    covered: NDArray[np.bool_]
    visible: NDArray[np.bool_]
    beside: FloatImage


class PanoramaPass:
    """Renders radiance of a DeviceScene in which some instances move, before a camera that turns or walks.

    Args:
        paths: Path tracer of the image size.
        memory_limit: Limit of the memory of all panoramas, bytes. One view's cells are kept even if they exceed it.
        images: Disk cache of base images, in whose folder cells are kept too; None: none.
        progress: Called with the name of a stage and its completed fraction, 0..1.

    Attributes:
        panoramas: Those in memory.
        static_hits: What the view prepared last shows of static instances; None: it was not traced for this frame.
    """

    def __init__(
        self,
        paths: PathPass,
        *,
        memory_limit: int,
        images: BaseImageCache | None = None,
        progress: ProgressCallback = no_progress,
    ) -> None:
        self.scene = paths.scene
        self._paths = paths
        self._changes: LightChanges | None = None
        self._cell_paths = PathPass(paths.scene, paths.width, paths.height)  # of cells and subpixels
        self._subpixels = SubpixelPaths(self._cell_paths)
        self.static_hits: StaticHits | None = None
        self._anchors, self._points = Anchors(paths.scene), Reprojection(paths.scene)
        self.panoramas = Panoramas(self._cell_paths, self._anchors, images, memory_limit, progress)
        self._label_hits = RayArrays()
        self._static: _StaticImage | None = None
        self._recorded_spp = 0  # paths per pixel of `_changes`, which serve again where a view rests

    def prepare(
        self,
        view: View,
        placement: Placement,
        moving: NDArray[np.bool_],
        *,
        frame_index: int,
        seed: int,
        spp: int,
        panorama_spp: int,
        max_depth: int,
    ) -> bool:
        """Make the static image of a frame. Afterwards the frame must be placed again.

        Args:
            view: Camera and image size.
            placement: Placement of the frame.
            moving: bool [n], the instances that are not in the panorama.
            frame_index: Frame number; with `seed` it selects the random numbers, unless the camera stands still.
            seed: Seed of the random numbers.
            spp: Paths per pixel of reduced size that find the movers' changes of light.
            panorama_spp: Samples per pixel of the panorama.
            max_depth: Largest number of segments of a path.

        Returns:
            Whether there is a panorama that serves the view. False: the frame must be rendered otherwise.
        """
        if SUBPIXELS * view.width * view.height > MAX_PIXELS:
            return False
        static = base_placement(placement, moving)
        contents = view.background, *static_scene_key(self.scene, static, static.present[CURRENT])
        key = (view, panorama_spp, max_depth, seed, *contents)
        if self._static is None or key != self._static.key:
            self._static, self._recorded_spp = None, 0
            if walks(view):
                self.scene.place(static)  # for what follows to trace
            anchor = self._anchors.nearest(view)
            if anchor is None:
                return False
            settings = PanoramaSettings.of(view, anchor, spp=panorama_spp, max_depth=max_depth, seed=seed)
            if not settings.possible:
                return False
            points = None if anchor == view.current.position else self._points
            if points is not None:
                points.trace(view, anchor)
            panorama, images = self.panoramas.images(view, static, settings, contents, points)
            self._static = _StaticImage(key if view.is_still else None, *images, panorama.probe, points is not None)
        self.static_hits = None
        if self._static.is_anchored:
            # Labels change the hits, and where the view rests they serve again.
            hits = self._label_hits.copy_of(self._points.centers) if view.is_still else self._points.centers
            self.static_hits = StaticHits(hits, moving)
        if view.is_still:
            frame_index = 0  # noise stands still where the camera does, as in incremental rendering
        self._view, self._max_depth, self._panorama_spp = view, max_depth, panorama_spp
        self._movers_key = frame_key(frame_key(seed, MOVERS_FRAME), frame_index)
        if (moving & placement.present[CURRENT]).any() and spp != self._recorded_spp:
            if self._changes is None:
                self._changes = LightChanges(self.scene, view)
            self.scene.place(static)
            keys = (frame_key(frame_key(seed, frame), frame_index) for frame in (CHANGES_FRAME, OPACITY_FRAME))
            depth = min(max_depth, CHANGES_DEPTH)
            self._changes.record(view, placement, moving, self._static.probe, keys, spp=spp, max_depth=depth)
            self._recorded_spp = spp
        return True

    def render(self, moving: NDArray[np.bool_], instance: NDArray[np.int32], *, spp: int) -> PanoramaImage:
        """Render what the scene has placed at CURRENT, over the static image prepared last, which it changes.

        Args:
            moving: bool [n], the instances that are not in the panorama, as for `prepare`.
            instance: The frame's label of that name, int32 [h, w].
            spp: Paths per subpixel that shows a mover, or what the panorama does not.
        """
        shown = self._static
        assert shown is not None, "made by prepare()"
        factors = self.scene.placement.light_factors
        radiance, denoised, albedo, normal = shown.light(factors)
        moving = moving & self.scene.placement.present[CURRENT]
        movers = self._find_movers(moving, instance, radiance, factors) if moving.any() else None
        traced = np.zeros(instance.shape, bool) if movers is None else movers.visible
        beside = np.zeros(instance.shape, np.float32) if movers is None else movers.beside
        known_share = _SHARES[shown.known]
        unknown = known_share < 0.5
        if unknown.any():
            traced |= unknown & dilated(dilated(~dilated(dilated(~unknown))))  # not strips beside edges
        beside[traced | unknown] = 0.0
        blended = beside > 0.0
        traced |= blended
        panorama = radiance[blended], denoised[blended]
        static_mask = np.where(blended, np.float32(1.0), np.where(traced, np.float32(0.0), known_share))[..., None]
        hidden = self._subpixels.fill(
            self._view, np.where(traced, np.int32(NONE_KNOWN), shown.known), (radiance, denoised, albedo, normal),
            spp=spp, key=self._movers_key, max_depth=self._max_depth,
            scene=replace(self._paths.scene_arrays(), cache=shown.probe.cache(factors)),
        )  # fmt: skip
        static = radiance.copy() if blended.any() else radiance
        radiance[blended], denoised[blended] = panorama
        before, white, reduced_normal = demodulate(radiance, albedo, normal, REDUCTION)
        change, after, emitted = None, None, None
        if movers is not None:
            per_albedo = 1.0 / (block_means(albedo, REDUCTION) + ALBEDO_OFFSET)
            change, after = self._changed(movers, radiance, before, per_albedo)
            emitted = self._emitted(moving, movers, per_albedo)
        return PanoramaImage(
            static=static,
            albedo=albedo,
            normal=normal,
            denoised=denoised,
            hidden=hidden,
            before=before,
            change=change,
            after=after,
            emitted=emitted,
            white=white,
            reduced_normal=reduced_normal,
            traced=traced,
            beside=beside,
            static_mask=static_mask,
            panorama_spp=self._panorama_spp,
        )

    def _find_movers(
        self, moving: NDArray[np.bool_], instance: NDArray[np.int32], radiance: FloatImage, factors: FloatImage
    ) -> _Movers:
        assert self._changes is not None, "made by prepare()"
        correction = self._changes.find(moving, factors)
        hits = correction[..., MOVER_HITS] > 0.0
        labeled = np.isin(instance, self.scene.placement.instance_id[moving])
        covered = block_means(labeled[..., None].astype(np.float32), REDUCTION)[..., 0] > 0.0
        # Parts of movers between the pixels' centers are in no label.
        visible = dilated(labeled | _enlarged(hits & ~covered, instance.shape))
        light, covered = block_means(radiance, REDUCTION), hits | covered
        changed = changed_beside_movers(correction[..., :3], light, hits, covered)
        return _Movers(correction[..., :3], hits, covered, visible, interpolated(changed, instance.shape, REDUCTION))

    def _changed(
        self, movers: _Movers, radiance: FloatImage, before: FloatImage, per_albedo: FloatImage
    ) -> tuple[FloatImage | None, FloatImage | None]:
        """Return `change` and `after` of the image, irradiance."""
        if not movers.correction.any():
            return None, None
        assert self._changes is not None, "it has found the movers"
        reduced = block_means(radiance, REDUCTION)
        filtered = self._changes.without_outliers(reduced)
        after = np.maximum(before + _filled((filtered - reduced) * per_albedo, movers.hits), 0.0)
        return _filled(movers.correction * per_albedo, movers.hits), after

    def _emitted(self, moving: NDArray[np.bool_], movers: _Movers, per_albedo: FloatImage) -> FloatImage | None:
        """Return irradiance by movers that emit light; None: none does."""
        emitting = moving & self.scene.emissive.of(self.scene.placement.mesh)
        if not emitting.any():
            return None
        assert self._changes is not None, "it has found the movers"
        key = frame_key(self._movers_key, LIGHT_FRAME)
        light = self._changes.light_of(emitting, self._view, key=key, spp=self._recorded_spp, max_depth=self._max_depth)
        return _filled(light * per_albedo, movers.covered)  # movers themselves have more of it


def _enlarged(mask: NDArray[np.bool_], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return a mask of reduced size in the full size, [h, w]."""
    return mask.repeat(REDUCTION, 0).repeat(REDUCTION, 1)[: shape[0], : shape[1]]


def _filled(change: FloatImage, unknown: NDArray[np.bool_]) -> FloatImage:
    """Return changes of light with the unknown ones replaced by the mean of the known ones around them."""
    weights = np.pad(1.0 - unknown[..., None].astype(np.float32), ((2, 2), (2, 2), (0, 0)))
    values = np.pad(np.where(unknown[..., None], np.float32(0.0), change), ((2, 2), (2, 2), (0, 0)))
    windows = [np.lib.stride_tricks.sliding_window_view(each, (5, 5), axis=(0, 1)) for each in (values, weights)]
    sums, counts = (window[unknown].sum(axis=(-2, -1), dtype=np.float32) for window in windows)
    result = change.copy()
    result[unknown] = sums / np.maximum(counts, 1.0)
    return result
