# SPDX-License-Identifier: Apache-2.0
"""Procedural textures: every function is a pure function of its size and a seed; most results are tileable.

Colors are scene-linear albedos until `images.save` encodes them; u runs along columns, row 0 is the top.
"""
