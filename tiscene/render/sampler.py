"""Owen-scrambled Sobol points without tables or state: a number depends only on what it is for.

The 4-D Sobol sequence is scrambled and shuffled by hashing (Burley, "Practical Hash-Based Owen Scrambling", 2020, with
Vegdahl's hash), and every four dimensions of a path are another copy of it, padded. Everything is keyed by (seed,
frame, pixel) through `pixel_key`, then by the set of dimensions and the sample's index.
"""

import taichi as ti

u32 = ti.u32
vec2 = ti.math.vec2
vec4 = ti.math.vec4

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
def pixel_key(frame_key: ti.i32, pixel: ti.i32) -> u32:
    """The key of a pixel's numbers in one frame."""
    return combine(ti.cast(frame_key, u32), ti.cast(pixel, u32))


@ti.func
def uniform(key: u32) -> ti.f32:
    """A lone number in [0, 1) for a key, not stratified."""
    return ti.cast(mix(key) >> 8, ti.f32) * _TO_UNIT


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
def scrambled(x: u32, key: u32) -> ti.f32:
    """A bit-reversed Sobol coordinate to a number in [0, 1)."""
    return ti.cast(reverse_bits(scramble_reversed(x, key)) >> 8, ti.f32) * _TO_UNIT


@ti.func
def shuffled_index(key: u32, index: ti.i32) -> u32:
    """Which point sample `index` of the copy named by `key` is: its number, bit-reversed."""
    return scramble_reversed(reverse_bits(ti.cast(index, u32)), mix(key))


@ti.func
def first_two(key: u32, shuffled: u32, bits: ti.i32) -> vec2:
    """Dimensions 0 and 1 of a point in [0, 1)^4; shuffled: its `shuffled_index`.

    bits: the indices in use are below 2**bits. Only so many bits of the index are shuffled and looked at: the points of
    a pixel are then one whole net.
    """
    # Direction numbers, bit-reversed, by the recurrence of the primitive polynomials 1 and x + 1.
    x0, x1 = u32(0), u32(0)
    v0, v1 = u32(1), u32(1)
    rest = shuffled
    for _ in range(bits):
        chosen = u32(0) - (rest >> 31)  # all bits or none: a branch here would be guessed wrong half of the time
        x0 ^= v0 & chosen
        x1 ^= v1 & chosen
        rest <<= 1
        v0 <<= 1
        v1 ^= v1 << 1
    return vec2(scrambled(x0, mix(key + u32(0x9E3779B9))), scrambled(x1, mix(key + u32(0x3C6EF372))))


@ti.func
def last_two(key: u32, shuffled: u32, bits: ti.i32) -> vec2:
    """Dimensions 2 and 3 of the same point: apart, because many a path has no use for them."""
    # Of x^2 + x + 1 and x^3 + x + 1, with Joe and Kuo's initial values.
    x2, x3 = u32(0), u32(0)
    a0, a1 = u32(1), u32(3)
    b0, b1, b2 = u32(1), u32(3), u32(4)
    rest = shuffled
    for _ in range(bits):
        chosen = u32(0) - (rest >> 31)
        x2 ^= a0 & chosen
        x3 ^= b0 & chosen
        rest <<= 1
        a2 = a1 ^ a0 ^ (a0 << 2)
        a0 = a1
        a1 = a2
        b3 = b1 ^ b0 ^ (b0 << 3)
        b0 = b1
        b1 = b2
        b2 = b3
    return vec2(scrambled(x2, mix(key + u32(0xDAA66D2B))), scrambled(x3, mix(key + u32(0x78DDE6E4))))


@ti.func
def sobol(key: u32, index: ti.i32, bits: ti.i32) -> vec4:
    """Point `index` of the copy named by `key`; [0, 1)^4."""
    shuffled = shuffled_index(key, index)
    first, last = first_two(key, shuffled, bits), last_two(key, shuffled, bits)
    return vec4(first.x, first.y, last.x, last.y)


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
