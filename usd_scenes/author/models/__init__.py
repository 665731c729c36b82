# SPDX-License-Identifier: Apache-2.0
"""Furniture, clutter and plants: each function builds one Thing, standing on y = 0 about x = z = 0, facing +z."""
