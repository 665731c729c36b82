# SPDX-License-Identifier: Apache-2.0
"""Tileable textures, generated: every function is a pure function of its size and a seed.

Colors are scene-linear albedos until `images.save` encodes them; u runs along columns, row 0 is the top.
"""
