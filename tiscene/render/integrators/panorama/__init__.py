# SPDX-License-Identifier: Apache-2.0
"""Rendering of a camera that turns or walks: static light from panoramas, changed by movers.

A panorama holds the radiance that reaches one point from the static scene, for cells of the sphere of directions. Cells
are computed when a view first shows them. They depend on the scene, the lights, the seed and the cell alone, so that
frames have the same bytes in any order and in any process. A camera that turns shows a panorama around its own center,
one that walks a panorama around a point of a lattice nearby.

::

    panorama_pass         PanoramaPass: prepare a frame's static image, render the frame over it
    anchors               the points around which panoramas are
    reprojection          images of a panorama seen from elsewhere
    reprojection_kernels  its kernels
    subpixels             paths through what a panorama does not know
    panoramas             the panoramas of a scene, in memory and on disk
    light_changes         what movers change on static surfaces
    panorama              cells around one point, traced tile by tile and denoised block by block
    panorama_kernels      kernels that find and resample cells
    light_probe           coarse light all around a point, in which paths end
    light_probes          the probes of a scene, which panoramas nearby share
    light_probe_kernels   its kernel
    packed_cells          their values in 16 bits
    cell_store            cells in memory
    cell_files            cells on disk
"""
