# SPDX-License-Identifier: Apache-2.0
"""Owen-scrambled Sobol points without tables or state: a number depends only on what it is for.

Every two dimensions of a path are another copy of the first two of the Sobol sequence, scrambled and shuffled by
hashing (Burley, "Practical Hash-Based Owen Scrambling", 2020, with Vegdahl's hash) under a key of the frame and the
set. All pixels of a picture share it: the points of one are consecutive, and those of its neighbors are near them
(`pixel_order`), so that they are spread as a net together, too, and what remains of noise is high in frequency (Ahmed
and Wonka, "Screen-Space Blue-Noise Diffusion of Monte Carlo Sampling Error via Hierarchical Ordering of Pixels", 2020).
"""

from functools import lru_cache

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Template, u32, uint3, vec2

_TO_UNIT = 1.0 / 16777216.0


@ti.func
def mix(x: u32) -> u32:
    """A bijection of 32-bit words that changes half of the bits for a change of any (Wellons' lowbias32)."""
    x = (x ^ (x >> 16)) * u32(0x7FEB352D)
    x = (x ^ (x >> 15)) * u32(0x846CA68B)
    return x ^ (x >> 16)


@ti.func
def combine(key: u32, value: u32) -> u32:
    """A key for `value` under `key`."""
    return mix(key ^ (value * u32(0x9E3779B9) + u32(0x85EBCA6B)))


@ti.func
def uniform(key: u32) -> ti.f32:
    """A lone number in [0, 1) for a key, not stratified."""
    return unit(mix(key))


@ti.func
def reverse_bits(x: u32) -> u32:
    """The 32 bits in the opposite order."""
    x = ((x >> 1) & u32(0x55555555)) | ((x & u32(0x55555555)) << 1)
    x = ((x >> 2) & u32(0x33333333)) | ((x & u32(0x33333333)) << 2)
    x = ((x >> 4) & u32(0x0F0F0F0F)) | ((x & u32(0x0F0F0F0F)) << 4)
    x = ((x >> 8) & u32(0x00FF00FF)) | ((x & u32(0x00FF00FF)) << 8)
    return (x >> 16) | (x << 16)


@ti.func
def scramble_reversed(x: u32, key: u32) -> u32:
    """Owen's nested uniform scramble of a bit-reversed word: each bit is flipped by a hash of the bits below it."""
    x ^= x * u32(0x3D20ADEA)
    x += key
    x *= (key >> 16) | u32(1)
    x ^= x * u32(0x05526C56)
    x ^= x * u32(0x53A22864)
    return x


@ti.func
def unit(word: u32) -> ti.f32:
    """A number in [0, 1) by the upper bits of a word."""
    return ti.cast(word >> 8, ti.f32) * _TO_UNIT


@ti.func
def set_key(frame_key: ti.i32, number: ti.i32) -> u32:
    """The key of a set of numbers in one frame."""
    return combine(ti.cast(frame_key, u32), ti.cast(number, u32))


@ti.func
def set_keys(frame_key: ti.i32, number: ti.i32) -> uint3:
    """What `draw` takes for a set of two dimensions. All paths share it: for kernels to make before their loops."""
    key = set_key(frame_key, number)
    return uint3(mix(key), mix(key + u32(0x9E3779B9)), mix(key + u32(0x3C6EF372)))


@ti.func
def draw(keys: uint3, index: u32) -> vec2:
    """A point in [0, 1)^2 of a set. index: its number, bit-reversed."""
    x, y = draw_words(keys, index)
    return vec2(unit(x), unit(y))


@ti.func
def draw_words(keys: uint3, index: Template):
    """The same as two words, of which `unit` makes numbers; of one index or of lanes of them."""
    x = reverse_bits(scramble_reversed(index, keys[0]))  # Owen's scramble of a number: its nets stay nets
    # The direction numbers of the first dimension, bit-reversed, are z^k, those of the second (1 + z)^k mod 2.
    y = x
    y ^= (y >> 16) & u32(0x0000FFFF)
    y ^= (y >> 8) & u32(0x00FF00FF)
    y ^= (y >> 4) & u32(0x0F0F0F0F)
    y ^= (y >> 2) & u32(0x33333333)
    y ^= (y >> 1) & u32(0x55555555)
    return reverse_bits(scramble_reversed(x, keys[1])), reverse_bits(scramble_reversed(y, keys[2]))


@lru_cache(maxsize=8)
def pixel_order(width: int, height: int) -> NDArray[np.int32]:
    """The place of every pixel in a hierarchical order, int32 [width * height]: neighbors are near each other in it.

    Morton's order of quarters within quarters. Which two of four go together, side by side, one above the other or
    across, is drawn for each four, as all orders of them would do; the sampler's shuffle does the rest.
    """
    y, x = (axis.ravel().astype(np.uint32) for axis in np.mgrid[:height, :width])
    place = np.zeros(width * height, np.uint32)
    for level in reversed(range(index_bits(max(width, height)))):
        bit_x, bit_y = x >> level & 1, y >> level & 1
        if 1 << level < min(width, height):
            pair = _mixed(place + (level << 24)) % 3
            place = place << 1 | np.where(pair == 0, bit_x, np.where(pair == 1, bit_y, bit_x ^ bit_y))
            place = place << 1 | np.where(pair == 0, bit_y, bit_x)
        else:
            place = place << 1 | bit_x | bit_y
    return place.view(np.int32)


def _mixed(x: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """`mix` on the host."""
    x = (x ^ (x >> np.uint32(16))) * np.uint32(0x7FEB352D)
    x = (x ^ (x >> np.uint32(15))) * np.uint32(0x846CA68B)
    return x ^ (x >> np.uint32(16))


def index_bits(spp: int) -> int:
    """How many bits count `spp` samples."""
    return max(spp - 1, 0).bit_length()


def frame_key(seed: int, frame_index: int) -> int:
    """One 32-bit key (as a signed integer) for a seed and a frame, by SplitMix64's finaliser."""
    mask = (1 << 64) - 1
    x = 0x9E3779B97F4A7C15
    for value in (seed, frame_index):
        x = (x ^ (value & mask)) * 0xBF58476D1CE4E5B9 & mask
        x = (x ^ (x >> 30)) * 0x94D049BB133111EB & mask
        x ^= x >> 31
    word = x >> 32
    return word - (1 << 32) if word >= 1 << 31 else word
