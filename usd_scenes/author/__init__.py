# SPDX-License-Identifier: Apache-2.0
"""Code that authors the scenes and templates beside it: `python -m usd_scenes.author [NAME ...]`.

mesh → shapes, soft → things (furniture, clutter, plants) → templates, rooms; textures and materials → looks;
stage writes them as USD. Everything is a pure function of its arguments and a seed, so that files can be made again.
"""
