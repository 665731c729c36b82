# SPDX-License-Identifier: Apache-2.0
"""Furniture, clutter and plants: each function builds a `Model` that stands on y = 0 about x = z = 0 and faces +z."""
