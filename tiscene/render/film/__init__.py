# SPDX-License-Identifier: Apache-2.0
"""From radiance samples to displayable images.

::

    adaptive      sample each pixel until its error estimate is small enough
    denoise       Intel Open Image Denoise
    postprocess   denoise and upsample radiance images
    upsample      guided upsampling along label edges
    smooth_light  replacement of light where it varies slowly
    tone_map      exposure, tone curve, sRGB
"""
