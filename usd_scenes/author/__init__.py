# SPDX-License-Identifier: Apache-2.0
"""Authoring of the shipped scenes and templates: `python -m usd_scenes.author [NAME ...]`.

Everything is a pure function of its arguments and a seed, so that running it again writes the same files. In order:
`polygon_mesh` (meshes), `shapes`, `sheets`, `soft`, `implicit` and `cloth_simulation` (geometry), `textures` (images),
`material_presets` (materials by name), `models` (furniture, clutter, plants as `model.Model`), `templates` and rooms,
`primitives` (their approximation by gprims), `usd_writer` (USD files), `category_registry` (ids of categories).
"""
