# SPDX-License-Identifier: Apache-2.0
"""Random numbers and sampling of distributions.

::

    sobol         Owen-scrambled Sobol points
    warp          maps from the unit square to distributions, with densities
    pixel_filter  importance-sampled pixel filters
    cube          directions as places on the faces of a cube
"""
