# SPDX-License-Identifier: Apache-2.0
"""Light of moving cameras compared with converged pictures: its mean and its structural similarity.

Frames of `moving` over panoramas, against path tracing of two parts of REFERENCE_SPP samples per pixel. "mean": mean
radiance of `denoised` over that of the raw reference. "similarity": structural similarity (Wang et al. 2004, Gaussian
of 1.5 px) of the luminance of light, that is radiance over the image's own albedo, encoded as sRGB. The reference is
denoised too, and what remains of its noise counts as dissimilar, in proportion to one over its samples: "converged" is
twice the similarity to both parts together, less the mean similarity to each. "128 spp" is path tracing denoised alike.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from unittest import mock

import numpy as np
from scipy.ndimage import gaussian_filter

import tiscene as ts
from tests.benchmarks import moving
from tests.benchmarks.moving import COMPARED, ROOMS, Displayed, Image, Shot
from tests.benchmarks.reference_pictures import note
from tiscene.frame.difficulty import LUMINANCE
from tiscene.render.film.denoise import denoise
from tiscene.render.film.postprocess import Postprocessor
from tiscene.render.film.upsample import ALBEDO_OFFSET

REFERENCE_SPP = 256  # of each of the two parts
CAMERAS, PRESETS = ("turns", "walks"), ("fast", "preview")
_SIGMA, _K1, _K2 = 1.5, 0.01, 0.03  # of structural similarity


def main(large: bool = False) -> None:
    """Print one line for each room, camera and preset, at 256x192 or, if large, at 640x480."""
    print(f"{'':<8} {'camera':<6} {'':<9} {'mean':>8} {'similarity':>10} {'converged':>10}")
    for room in ROOMS:
        for camera in CAMERAS:
            shot = Shot(room, camera, (640, 480) if large else moving.SIZE)
            note(f"{room}, camera {camera}: references")
            compare(shot)


def compare(shot: Shot) -> None:
    """Measure and print the presets, and path tracing with 128 samples per pixel."""
    parts = [_path_traced(shot, seed, REFERENCE_SPP) for seed in (1, 2)]
    truth = [tuple(0.5 * (a + b) for a, b in zip(one, other, strict=True)) for one, other in zip(*parts, strict=True)]
    whole, halves = [_light_of(*each) for each in truth], [[_light_of(*each) for each in part] for part in parts]
    mean = np.mean([radiance for radiance, _, _ in truth])
    pictures = {preset: _frames(shot, preset) for preset in PRESETS}
    pictures["128 spp"] = [(_denoised(*each), each[1]) for each in _path_traced(shot, 3, 128)]
    for name, pairs in pictures.items():
        lights = [_light(*pair) for pair in pairs]
        to_whole = _mean_similarity(lights, whole)
        to_halves = np.mean([_mean_similarity(lights, half) for half in halves])
        print(
            f"{shot.room:<8} {shot.camera:<6} {name:<9} {np.mean([pair[0] for pair in pairs]) / mean:>8.4f}"
            f" {to_whole:>10.4f} {2.0 * to_whole - to_halves:>10.4f}",
            flush=True,
        )


def _frames(shot: Shot, preset: str) -> list[tuple[Image, Image]]:
    """Return `denoised` and albedo of the frames compared."""
    with _guides("process_panorama") as guides, shot.stream(quality=preset, buffers=("denoised",)) as stream:
        frames = [shot.render(stream, index).denoised for index in COMPARED]
    return list(zip(frames, [albedo for albedo, _ in guides], strict=True))


def _path_traced(shot: Shot, seed: int, spp: int) -> list[tuple[Image, Image, Image]]:
    """Return radiance, albedo and normal of the frames compared."""
    settings: dict[str, object] = {"quality": "standard", "max_depth": moving.REFERENCE_DEPTH, "incremental": False}
    with (
        _guides("process") as guides,
        shot.stream(spp=spp, seed=seed, denoise=False, buffers=("hdr",), **settings) as stream,
    ):
        frames = [shot.render(stream, index).hdr for index in COMPARED]
    return [(frame, *guide) for frame, guide in zip(frames, guides, strict=True)]


@contextmanager
def _guides(method: str) -> Iterator[list[tuple[Image, Image]]]:
    """Collect albedo and normal of the images that a `Postprocessor` is given, pixel means: no buffer has them."""
    result: list[tuple[Image, Image]] = []
    original = getattr(Postprocessor, method)

    def collecting(postprocessor: Postprocessor, image: ts.PathImage, *guides: Image) -> Image:
        result.append((image.albedo, image.normal))
        processed: Image = original(postprocessor, image, *guides)
        return processed

    with mock.patch.object(Postprocessor, method, collecting):
        yield result


def _denoised(radiance: Image, albedo: Image, normal: Image) -> Image:
    return denoise(radiance, albedo, normal, "high", clean=False)


def _light_of(radiance: Image, albedo: Image, normal: Image) -> Displayed:
    return _light(_denoised(radiance, albedo, normal), albedo)


def _light(radiance: Image, albedo: Image) -> Displayed:
    light = radiance / (albedo + ALBEDO_OFFSET)
    return moving.display(0.5 * light) @ LUMINANCE  # which doubles radiance; light is about twice as bright already


def _mean_similarity(lights: list[Displayed], others: list[Displayed]) -> float:
    return float(np.mean([similarity(*pair) for pair in zip(lights, others, strict=True)]))


def similarity(one: Displayed, other: Displayed) -> float:
    """Return the structural similarity of two images, float64 [h, w], 0..1."""

    def blurred(image: Displayed) -> Displayed:
        result: Displayed = gaussian_filter(image, _SIGMA)
        return result

    mean, other_mean = blurred(one), blurred(other)
    variance, other_variance = blurred(one**2) - mean**2, blurred(other**2) - other_mean**2
    covariance = blurred(one * other) - mean * other_mean
    luminance = (2.0 * mean * other_mean + _K1**2) / (mean**2 + other_mean**2 + _K1**2)
    structure = (2.0 * covariance + _K2**2) / (variance + other_variance + _K2**2)
    return float((luminance * structure).mean())


if __name__ == "__main__":
    main()
