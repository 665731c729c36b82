# SPDX-License-Identifier: Apache-2.0
"""Renderer: all rendered buffers of a frame.

The label pass always runs. If color buffers are requested, radiance comes from the panorama pass if the camera moves,
from the incremental pass if it stands still and movers leave most light unchanged, else from the path pass; it is then
denoised, upsampled and tone mapped.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ArgumentError
from tiscene.frame.buffers import COLORS, times_needed
from tiscene.render.film.adaptive import render_to_error
from tiscene.render.film.postprocess import Postprocessor
from tiscene.render.film.tone_map import auto_exposure, tone_map
from tiscene.render.film.upsample import reduced_size
from tiscene.render.film.visible_lights import visible_lights
from tiscene.render.integrators.incremental.base_image import ProgressCallback, no_progress
from tiscene.render.integrators.incremental.base_image_cache import BaseImageCache
from tiscene.render.integrators.incremental.incremental_pass import CACHE_BYTES, IncrementalImage, IncrementalPass
from tiscene.render.integrators.labels.label_pass import LabelPass
from tiscene.render.integrators.labels.surface_labels import FILTERED_ALBEDO
from tiscene.render.integrators.panorama.panorama_pass import PanoramaImage, PanoramaPass
from tiscene.render.integrators.path.path_frames import PathFrames
from tiscene.render.integrators.path.path_image import PathImage
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.render_settings import RenderSettings
from tiscene.render.view import View
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, Placement

FloatImage = NDArray[np.float32]

# Labels that guide the upsampling of light traced at reduced size.
UPSAMPLING_GUIDES = (FILTERED_ALBEDO, "normal")


@dataclass(frozen=True, eq=False)
class ShutterSample:
    """Part of a frame's samples while the shutter is open.

    Attributes:
        view: The camera at that time.
        placement: The instances at that time.
        spp: Samples per pixel of this part.
    """

    view: View
    placement: Placement
    spp: int


class Renderer:
    """Renders images of one size of one device scene.

    Args:
        scene: The scene.
        width: Image width, px.
        height: Image height, px.
        settings: Render settings.
        cache_bytes: Limit of the cached paths' memory in incremental rendering.
        progress: Called with the name of a stage and its completed fraction, 0..1.

    Attributes:
        spp: Mean samples per pixel of the color rendered last.
    """

    METER_SIZE = (64, 48)
    METER_SPP = 32

    def __init__(
        self,
        scene: DeviceScene,
        width: int,
        height: int,
        settings: RenderSettings,
        *,
        cache_bytes: int = CACHE_BYTES,
        progress: ProgressCallback = no_progress,
    ) -> None:
        self.scene = scene
        self.width = width
        self.height = height
        self.settings = settings
        self.spp = 0.0
        self._labels = LabelPass(scene)
        options: dict[str, Any] = {"pixel_filter": settings.pixel_filter, "clamp": settings.clamp}
        self._path_options = options
        self._path_frames: PathFrames | None = None
        self._paths = PathPass(scene, *reduced_size(width, height, settings.downscale), **options)
        self._full_size_paths = self._paths if settings.downscale == 1 else PathPass(scene, width, height, **options)
        kept: dict[str, Any] = {"images": BaseImageCache(), "progress": progress}
        self._incremental = IncrementalPass(self._full_size_paths, memory_limit=cache_bytes, **kept)
        self._panorama = PanoramaPass(self._full_size_paths, memory_limit=cache_bytes // 2, **kept)

    def render(
        self,
        view: View,
        placement: Placement,
        buffers: Sequence[str],
        *,
        frame_index: int,
        seed: int,
        exposure: float,
        moving: NDArray[np.bool_] | None = None,
        shutter_samples: Iterable[ShutterSample] = (),
        light: PathImage | None = None,
    ) -> dict[str, NDArray[Any]]:
        """Render the buffers of a frame.

        Args:
            view: Camera and image size.
            placement: The instances at the frame's time.
            buffers: Names of buffers.
            frame_index: Frame number; with `seed` it selects the random numbers.
            seed: Seed of the random numbers.
            exposure: Exposure of `rgb`, stops.
            moving: bool [n], the movers, if lights are static: color is rendered incrementally if that is estimated to
                be cheaper. None: color is path traced.
            shutter_samples: Color is the mean over these times, path traced at full size; empty: the frame's time.
            light: What `trace_frames` has found for the frame; None: light is to be traced.

        Returns:
            New arrays by name, in the order of `buffers`.
        """
        self._paths.background = self._full_size_paths.background = view.background
        settings = self.settings
        colored = not COLORS.isdisjoint(buffers)
        labels = [name for name in buffers if name not in COLORS]
        sampling: dict[str, int] = {"seed": seed, "max_depth": settings.max_depth}
        shared = None
        if colored and moving is not None:
            shared = self._prepare_shared(view, placement, moving, frame_index, sampling)
        if shared is self._panorama and "instance" not in labels:
            labels.append("instance")
        if colored and shared is None and settings.downscale > 1:
            labels += [name for name in (*UPSAMPLING_GUIDES, "distance") if name not in labels]
        if labels or light is None:
            self.scene.place(placement, times=times_needed([*buffers, *labels]))
        static_hits = self._panorama.static_hits if shared is self._panorama else None
        result = self._labels.render(view, labels, static_hits)
        if colored:
            self.spp = float(settings.spp)
            blurred = self._trace_shutter(shutter_samples, frame_index, seed)
            image: PathImage | PanoramaImage
            if moving is not None and shared is self._panorama:
                image = self._panorama.render(moving, result["instance"], spp=settings.spp)
            elif moving is not None and shared is self._incremental:
                image = self._incremental.render(moving)
            else:
                image = blurred or light or self._trace(self._traced_view(view), frame_index, seed)
            result |= self._color(image, view, exposure, buffers, result, is_blurred=blurred is not None)
        return {name: result[name] for name in buffers}

    def shares_light(self, view: View) -> bool:
        """Return whether frames of a view can share light: its camera stands still, or a panorama serves it."""
        return view.is_still or self._over_panorama(view)

    def render_labels(
        self, views: Sequence[View], placements: Sequence[Placement], buffers: Sequence[str]
    ) -> list[dict[str, NDArray[Any]]] | None:
        """Render the label buffers of several frames at once; see `LabelPass.render_frames`."""
        return self._labels.render_frames(views, placements, buffers)

    def trace_frames(
        self, views: Sequence[View], placements: Sequence[Placement], frame_indices: Sequence[int], *, seed: int
    ) -> list[PathImage] | None:
        """Path trace several frames at once; None where it is adaptive, or see `PathFrames.render_frames`."""
        settings = self.settings
        if settings.relative_error is not None:
            return None
        if self._path_frames is None:
            paths = self._paths
            self._path_frames = PathFrames(self.scene, paths.width, paths.height, **self._path_options)
        return self._path_frames.render_frames(
            [self._traced_view(view) for view in views], placements, frame_indices,
            seed=seed, spp=settings.spp, max_depth=settings.max_depth,
        )  # fmt: skip

    def auto_exposure(self, view: View, placement: Placement, *, seed: int) -> float:
        """Return the automatic exposure for a placement, stops, metered in a small image.

        Args:
            view: Camera; its image size is ignored.
            placement: The instances.
            seed: Seed of the random numbers.
        """
        width, height = self.METER_SIZE
        self.scene.place(placement, times=(CURRENT,))
        view = View(*view.cameras, width=width, height=height)
        image = PathPass(self.scene, width, height).render(
            view, frame_index=0, seed=seed, spp=self.METER_SPP, max_depth=self.settings.max_depth
        )
        return float(np.round(auto_exposure(image.hdr), 3))

    def _over_panorama(self, view: View, lit_by_movers: bool = False) -> bool:
        return self.settings.panorama_spp > 0 and (view.pinhole_moves or (lit_by_movers and view.is_pinhole))

    def _prepare_shared(
        self,
        view: View,
        placement: Placement,
        moving: NDArray[np.bool_],
        frame_index: int,
        sampling: dict[str, int],
    ) -> IncrementalPass | PanoramaPass | None:
        """Return the pass that shares light with other frames, prepared; None: the frame is path traced by itself."""
        settings = self.settings
        lit_by_movers = bool(self.scene.emissive.ever_of(placement.mesh)[moving].any())
        # At least two paths per pixel of reduced size: one leaves stains of color.
        if self._over_panorama(view, lit_by_movers) and self._panorama.prepare(
            view, placement, moving,
            frame_index=frame_index, spp=max(2, settings.spp), panorama_spp=settings.panorama_spp, **sampling,
        ):  # fmt: skip
            return self._panorama
        if not (view.is_still and self._incremental.is_cheaper(view, placement, moving, **sampling)):
            return None
        self._incremental.prepare(
            view, placement, moving,
            spp=settings.spp, base_spp=max(settings.base_spp, settings.spp), near_spp=settings.near_spp, **sampling,
        )  # fmt: skip
        return self._incremental

    def _color(
        self,
        image: PathImage | PanoramaImage,
        view: View,
        exposure: float,
        buffers: Sequence[str],
        labels: dict[str, NDArray[Any]],
        *,
        is_blurred: bool,
    ) -> dict[str, NDArray[Any]]:
        """Return the requested color buffers.

        Args:
            image: The frame's light, path traced or shared with other frames.
            view: Camera and image size.
            exposure: Exposure of `rgb`, stops.
            buffers: Names of the requested buffers.
            labels: Rendered labels, with UPSAMPLING_GUIDES and `distance` if light is traced at reduced size.
            is_blurred: Whether the image is the mean over the shutter interval, of full size.
        """
        settings, sharp = self.settings, view.current.lens_radius == 0.0 and not is_blurred
        downscale = 1 if is_blurred else settings.downscale
        denoising = Postprocessor(settings.denoiser if settings.denoise else None, downscale, sharp)
        is_traced = not isinstance(image, PanoramaImage | IncrementalImage)
        guides = self._guides(view, labels) if is_traced and downscale > 1 else (image.albedo, image.normal)
        result: dict[str, NDArray[Any]] = {}
        if "hdr" in buffers:
            result["hdr"] = replace(denoising, denoiser=None).process(image, *guides) if is_traced else image.hdr
        if "rgb" in buffers or "denoised" in buffers:
            radiance = denoising.process(image, *guides)
        if "denoised" in buffers:
            result["denoised"] = radiance
        if "rgb" in buffers:
            if any(view.ambient):
                albedo, normal = guides
                surface = normal.any(axis=-1, keepdims=True)
                radiance = radiance + np.where(surface, albedo, 0.0) * np.array(view.ambient, np.float32)
            result["rgb"] = tone_map(radiance, exposure)
        return result

    def _guides(self, view: View, labels: dict[str, NDArray[Any]]) -> tuple[FloatImage, FloatImage]:
        """Return albedo and normal for upsampling; the normal is zero where a light is in front of the surface."""
        albedo, normal = (labels[name] for name in UPSAMPLING_GUIDES)
        if not self.scene.lights.any_visible:
            return albedo, normal
        shown = visible_lights(self.scene, view, labels["distance"])
        return albedo, np.where(shown[..., None], np.float32(0.0), normal)

    def _traced_view(self, view: View) -> View:
        """Return a view in the size in which light is traced."""
        if self.settings.downscale == 1:
            return view
        return replace(view, width=self._paths.width, height=self._paths.height)

    def _trace_shutter(self, samples: Iterable[ShutterSample], frame_index: int, seed: int) -> PathImage | None:
        """Return the mean over the shutter interval; None without samples."""
        settings, image, first = self.settings, None, 0
        for sample in samples:
            if settings.relative_error is not None:
                raise ArgumentError(
                    f"relative_error={settings.relative_error}: not available with an open shutter; give spp= instead, "
                    "or close the shutter with shutter=(0, 0)"
                )
            self.scene.place(sample.placement)
            image = self._full_size_paths.render(
                sample.view, frame_index=frame_index, seed=seed, spp=settings.spp, max_depth=settings.max_depth,
                sample_range=(first, sample.spp),
            )  # fmt: skip
            first += sample.spp
            self.spp = float(first)
        return image

    def _trace(self, view: View, frame_index: int, seed: int) -> PathImage:
        """Path trace an image, adaptively if a relative error is set."""
        settings = self.settings
        if settings.relative_error is None:
            return self._paths.render(
                view, frame_index=frame_index, seed=seed, spp=settings.spp, max_depth=settings.max_depth
            )
        image = render_to_error(
            self._paths, view, frame_index=frame_index, seed=seed,
            relative_error=settings.relative_error, max_spp=settings.spp, max_depth=settings.max_depth,
        )  # fmt: skip
        self.spp = float(image.samples.mean())
        return image
