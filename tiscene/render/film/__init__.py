# SPDX-License-Identifier: Apache-2.0
"""From radiance samples to displayable images.

::

    adaptive        sample each pixel until its error estimate is small enough
    denoise         Intel Open Image Denoise
    postprocess     denoise and upsample radiance images
    upsample        guided upsampling along label edges
    visible_lights  pixels that show a light in front of the surface of their labels
    light_nearby    light that hidden parts of pixels should have
    smooth_light    light of reduced size: what varies slowly, and what has changed
    shrinkage       changes of light, drawn to the mean around as far as they may be noise
    james_stein     noisy colors, drawn to expected ones
    tone_map        exposure, tone curve, sRGB
"""
