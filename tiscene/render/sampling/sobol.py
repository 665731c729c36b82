# SPDX-License-Identifier: Apache-2.0
"""Owen-scrambled Sobol points, stateless and without tables: a number is a function of (seed, frame, pixel, dimension).

Each pair of dimensions of a path uses the first two Sobol dimensions, scrambled and shuffled by hashing under a key of
the frame and the pair (Burley, "Practical Hash-Based Owen Scrambling", 2020, with Vegdahl's hash). All pixels of an
image share one sequence, in a hierarchical order of pixels (`pixel_order`): the points of a pixel are consecutive,
those of its neighborhood form a digital net as well, and the error is blue noise (Ahmed and Wonka, "Screen-Space
Blue-Noise Diffusion of Monte Carlo Sampling Error via Hierarchical Ordering of Pixels", 2020).
"""

from functools import lru_cache

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Template, u32, uint3, vec2

_TO_UNIT = 1.0 / 16777216.0


@ti.func
def mix(x: u32) -> u32:
    """Hash a 32-bit word, bijectively (Wellons' lowbias32)."""
    x = (x ^ (x >> 16)) * u32(0x7FEB352D)
    x = (x ^ (x >> 15)) * u32(0x846CA68B)
    return x ^ (x >> 16)


@ti.func
def combine(key: u32, value: u32) -> u32:
    """Derive a key from a key and a number."""
    return mix(key ^ (value * u32(0x9E3779B9) + u32(0x85EBCA6B)))


@ti.func
def uniform(key: u32) -> ti.f32:
    """Return an independent, unstratified number in [0, 1) for a key."""
    return unit(mix(key))


@ti.func
def reverse_bits(x: u32) -> u32:
    """Reverse the order of 32 bits."""
    x = ((x >> 1) & u32(0x55555555)) | ((x & u32(0x55555555)) << 1)
    x = ((x >> 2) & u32(0x33333333)) | ((x & u32(0x33333333)) << 2)
    x = ((x >> 4) & u32(0x0F0F0F0F)) | ((x & u32(0x0F0F0F0F)) << 4)
    x = ((x >> 8) & u32(0x00FF00FF)) | ((x & u32(0x00FF00FF)) << 8)
    return (x >> 16) | (x << 16)


@ti.func
def scramble_reversed(x: u32, key: u32) -> u32:
    """Apply Owen scrambling to a bit-reversed word: each bit is flipped by a hash of the bits below it."""
    x ^= x * u32(0x3D20ADEA)
    x += key
    x *= (key >> 16) | u32(1)
    x ^= x * u32(0x05526C56)
    x ^= x * u32(0x53A22864)
    return x


@ti.func
def unit(word: u32) -> ti.f32:
    """Convert the upper 24 bits of a word to a number in [0, 1)."""
    return ti.cast(word >> 8, ti.f32) * _TO_UNIT


@ti.func
def set_key(frame_key: ti.i32, number: ti.i32) -> u32:
    """Return the key of a set (a pair of dimensions) in one frame."""
    return combine(ti.cast(frame_key, u32), ti.cast(number, u32))


@ti.func
def set_keys(frame_key: ti.i32, number: ti.i32) -> uint3:
    """Return the keys that `draw` takes for a set. All paths share them: compute them before the loop over paths."""
    key = set_key(frame_key, number)
    return uint3(mix(key), mix(key + u32(0x9E3779B9)), mix(key + u32(0x3C6EF372)))


@ti.func
def draw(keys: uint3, index: u32) -> vec2:
    """Return point `index` (bit-reversed) of a set, in [0, 1)²."""
    x, y = draw_words(keys, index)
    return vec2(unit(x), unit(y))


@ti.func
def draw_words(keys: uint3, index: Template):
    """Return the point as two words, which `unit` converts; of one index or of lanes."""
    x = reverse_bits(scramble_reversed(index, keys[0]))  # shuffle: an Owen scramble of the index preserves nets
    # Bit-reversed direction numbers: z^k of the first dimension, (1 + z)^k mod 2 of the second.
    y = x
    y ^= (y >> 16) & u32(0x0000FFFF)
    y ^= (y >> 8) & u32(0x00FF00FF)
    y ^= (y >> 4) & u32(0x0F0F0F0F)
    y ^= (y >> 2) & u32(0x33333333)
    y ^= (y >> 1) & u32(0x55555555)
    return reverse_bits(scramble_reversed(x, keys[1])), reverse_bits(scramble_reversed(y, keys[2]))


@lru_cache(maxsize=8)
def pixel_order(width: int, height: int) -> NDArray[np.int32]:
    """Return each pixel's position, int32 [width * height], in a randomized Morton order, which keeps neighbors close.

    Of each 2x2 block the pairing (horizontal, vertical or diagonal) is random, which together with the sampler's
    shuffle gives all orders of the four equal probability.
    """
    y, x = (axis.ravel().astype(np.uint32) for axis in np.mgrid[:height, :width])
    position = np.zeros(width * height, np.uint32)
    for level in reversed(range(index_bits(max(width, height)))):
        bit_x, bit_y = x >> level & 1, y >> level & 1
        if 1 << level < min(width, height):
            pair = _mix_host(position + (level << 24)) % 3
            position = position << 1 | np.where(pair == 0, bit_x, np.where(pair == 1, bit_y, bit_x ^ bit_y))
            position = position << 1 | np.where(pair == 0, bit_y, bit_x)
        else:
            position = position << 1 | bit_x | bit_y
    return position.view(np.int32)


def _mix_host(x: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """`mix` on the host."""
    x = (x ^ (x >> np.uint32(16))) * np.uint32(0x7FEB352D)
    x = (x ^ (x >> np.uint32(15))) * np.uint32(0x846CA68B)
    return x ^ (x >> np.uint32(16))


def index_bits(spp: int) -> int:
    """Return the number of bits of the indices of `spp` samples."""
    return max(spp - 1, 0).bit_length()


def frame_key(seed: int, frame_index: int) -> int:
    """Return a 32-bit key, as a signed integer, for a seed and a frame (SplitMix64's finalizer)."""
    mask = (1 << 64) - 1
    x = 0x9E3779B97F4A7C15
    for value in (seed, frame_index):
        x = (x ^ (value & mask)) * 0xBF58476D1CE4E5B9 & mask
        x = (x ^ (x >> 30)) * 0x94D049BB133111EB & mask
        x ^= x >> 31
    word = x >> 32
    return word - (1 << 32) if word >= 1 << 31 else word
