# SPDX-License-Identifier: Apache-2.0
"""MaterialTable: all materials of a scene as three arrays, for kernels.

`values` holds the constant inputs of each material, `info` its flags, and `lookups` the texture lookups of the inputs
that have one.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from tiscene.device.memory import upload
from tiscene.scene.description import VERTEX_COLORS, ExtendedLobes, Material, TextureLookup
from tiscene.scene.input_track import InputTrack, by_row

# Columns of `values`: the first of each input (3 for a color, 1 for a number).
VALUE_COLUMNS = 20
DIFFUSE, EMISSIVE, SPECULAR, METALLIC, ROUGHNESS, CLEARCOAT, CLEARCOAT_ROUGHNESS, OPACITY = 0, 3, 6, 9, 10, 11, 12, 13
THRESHOLD, IOR = 14, 15

# Columns of `info`: flags, row of the glass energy tables, first row and number of rows of `lookups`, number of the
# rows of extended inputs, which follow.
INFO_COLUMNS = 5
FLAGS, GLASS_INDEX, FIRST_LOOKUP, LOOKUP_COUNT, EXTENDED_LOOKUP_COUNT = range(INFO_COLUMNS)
INPUTS = (
    ("diffuse_color", DIFFUSE),
    ("emissive_color", EMISSIVE),
    ("specular_color", SPECULAR),
    ("metallic", METALLIC),
    ("roughness", ROUGHNESS),
    ("clearcoat", CLEARCOAT),
    ("clearcoat_roughness", CLEARCOAT_ROUGHNESS),
    ("opacity", OPACITY),
)
NORMAL = VALUE_COLUMNS  # the input that has no constant

# Further columns of `values` in scenes with `ExtendedLobes`.
EXTENDED_COLUMNS = 48
TINT, ABSORPTION, SHEEN, SHEEN_ROUGHNESS, ANISOTROPY, ROTATION = 24, 27, 30, 33, 34, 35
SPECULAR_WEIGHT, SPECULAR_TINT, COAT_COLOR, TRANSLUCENCY, TRANSLUCENT_COLOR, COAT_IOR = 36, 37, 40, 43, 44, 47
EXTENDED_INPUTS = (
    ("transmission_color", TINT),
    ("absorption", ABSORPTION),
    ("sheen_color", SHEEN),
    ("sheen_roughness", SHEEN_ROUGHNESS),
    ("anisotropy", ANISOTROPY),
    ("rotation", ROTATION),
    ("specular", SPECULAR_WEIGHT),
    ("specular_tint", SPECULAR_TINT),
    ("coat_color", COAT_COLOR),
    ("coat_ior", COAT_IOR),
    ("translucency", TRANSLUCENCY),
    ("translucent_color", TRANSLUCENT_COLOR),
)

# Columns of `lookups`. LOOKUP_INPUT: the column of `values` that it replaces, or NORMAL. LOOKUP_SCALED_AREA: the factor
# by which the transform scales areas. LOOKUP_TEXTURE: below 0 (VERTEX_COLORS) for vertex colors. UNIT_NORMAL is the
# channel of an rgb whose length, with this scale and bias, is 1 in every pixel. LOOKUP_FACTOR: row of VERTEX_FACTORS.
LOOKUP_COLUMNS = 20
LOOKUP_TEXTURE, LOOKUP_CHANNEL, LOOKUP_SCALE, LOOKUP_BIAS, LOOKUP_TRANSFORM, LOOKUP_INPUT = 0, 1, 2, 6, 10, 16
LOOKUP_SCALED_AREA, LOOKUP_SET, LOOKUP_FACTOR = 17, 18, 19
CHANNELS = ("rgb", "r", "g", "b", "a")
UNIT_NORMAL = len(CHANNELS)
VERTEX_FACTORS = ("", "rgb", "a")

# Bits of the flags.
SPECULAR_WORKFLOW = 1
COVERAGE = 2  # opacity is alpha: the fraction of the surface that exists; rays pass the rest unchanged
GLASS = 4  # opacity below 1 makes the surface refract
MATTE = 8  # has only the diffuse lobe
TEXTURED = 16
EMITS = 32
COATED = 64
PLAIN = 128  # matte, constant and opaque: kernels read nothing else of it
MAY_MIRROR = 256  # may show clear reflections somewhere, and is not glass
EXTENDED = 512  # has ExtendedLobes
THIN = 1024  # is a sheet without thickness
TRANSLUCENT = 2048  # diffuse light passes
ABSORBS = 4096  # the solid absorbs light
UNSEEN = 8192  # rays from the camera pass

# Limits of MAY_MIRROR: roughness is below, and metallic or (in the specular workflow) specular color is above.
MIRROR_ROUGHNESS, MIRROR_METALLIC, MIRROR_SPECULAR = 0.15, 0.5, 0.5


class MaterialArrays(NamedTuple):
    """Device arrays of a material table; the columns are named by the constants of this module.

    Attributes:
        values: f32 [n, 20], [n, 48] with extended lobes.
        info: i32 [n, 5].
        lookups: f32 [k, 20].
    """

    values: Any
    info: Any
    lookups: Any


def flags_of(material: Material) -> int:
    """Return the flags of a material: what kernels may rely on.

    UsdPreviewSurface does not define partial opacity. Here it is coverage (alpha) where the author chose it (mode
    "presence", or a threshold), where it is a texture (leaves, lace, decals), and where nothing refracts (ior 1). Else
    the material is glass: the fraction `1 - opacity` of the light enters the solid that the mesh encloses. Materials of
    other models say which of the two it is: mode "presence" or "transmission".
    """
    flags = 0 if material.seen_by_camera else UNSEEN
    textured = [name for name, _ in INPUTS if isinstance(getattr(material, name), TextureLookup)]
    if textured or material.normal is not None:
        flags |= TEXTURED
    if material.use_specular_workflow:
        flags |= SPECULAR_WORKFLOW
    if material.opacity != 1.0:
        as_coverage = (
            material.opacity_mode == "presence"
            or material.opacity_threshold > 0.0
            or (isinstance(material.opacity, TextureLookup) and material.opacity_mode != "transmission")
            or (material.ior == 1.0 and not (material.lobes and material.lobes.thin_walled))
        )
        flags |= COVERAGE if as_coverage else GLASS
    if material.emissive_color != (0.0, 0.0, 0.0):
        flags |= EMITS
    if material.clearcoat != 0.0:
        flags |= COATED
    reflects = material.specular_color != (0.0, 0.0, 0.0) if material.use_specular_workflow else material.ior != 1.0
    metal = material.metallic != 0.0 and not material.use_specular_workflow
    if material.lobes is not None:
        flags |= _flags_of_lobes(material.lobes, flags)
    if not (reflects or metal or flags & (COATED | GLASS | EXTENDED)):
        flags |= MATTE
        if not flags & (TEXTURED | COVERAGE | UNSEEN):
            flags |= PLAIN
    if not flags & GLASS and _may_mirror(material):
        flags |= MAY_MIRROR
    return flags


def _flags_of_lobes(lobes: ExtendedLobes, flags: int) -> int:
    found = EXTENDED
    if lobes.thin_walled:
        found |= THIN
    elif flags & GLASS and lobes.absorption != (0.0, 0.0, 0.0):
        found |= ABSORBS
    if lobes.translucency != 0.0:
        found |= TRANSLUCENT
    return found


def _may_mirror(material: Material) -> bool:
    if not isinstance(material.roughness, TextureLookup) and material.roughness >= MIRROR_ROUGHNESS:
        return False
    if material.use_specular_workflow:
        specular = material.specular_color
        return isinstance(specular, TextureLookup) or min(specular) > MIRROR_SPECULAR
    return isinstance(material.metallic, TextureLookup) or material.metallic > MIRROR_METALLIC


class MaterialTable:
    """A growing table of materials. After `append`, the next `arrays` uploads them again.

    Attributes:
        materials: The materials, by row.
        flags: Their flags.
        possible_flags: The flags of all materials at all times together.
        may_pass: By row, whether rays from the camera ever pass the material: it is partly opaque, or unseen.
        labels: Names of materials by number: prim paths, else names. 0 is "". Materials may share a label.
    """

    def __init__(self) -> None:
        self.materials: list[Material] = []
        self.flags: list[int] = []
        self.possible_flags = 0
        self.may_pass: list[bool] = []
        self.labels: dict[int, str] = {0: ""}
        self._numbers: dict[str, int] = {"": 0}
        self._label_of_row: list[int] = []
        self._label_array: Any = None
        self._first_texture: list[int] = []
        self._opacity_tracks: dict[int, InputTrack] = {}  # by row
        self._arrays: MaterialArrays | None = None

    def __len__(self) -> int:
        return len(self.materials)

    def append(self, materials: Iterable[Material], first_texture: int, tracks: Iterable[InputTrack] = ()) -> int:
        """Add materials whose textures begin at a row of the atlas. Return the row of the first material.

        Args:
            materials: The materials.
            first_texture: The row of the atlas.
            tracks: How some of them vary, by their place in `materials`.
        """
        first, track_of = len(self.materials), by_row(tracks)
        for place, material in enumerate(materials):
            flags = possible = flags_of(material)
            if (track := track_of.get(place)) is not None:
                for sample in range(len(track.times)):
                    possible |= flags_of(track.applied(material, (sample, 0.0)))
                if possible & COVERAGE and (track.values("opacity") or track.values("opacity_threshold")):
                    self._opacity_tracks[len(self.materials)] = track
            self.materials.append(material)
            self.flags.append(flags)
            self.possible_flags |= possible
            self.may_pass.append(possible & (COVERAGE | UNSEEN) != 0)
            self._first_texture.append(first_texture)
            label = material.prim_path or material.name
            number = self._numbers.setdefault(label, len(self._numbers))
            self.labels[number] = label
            self._label_of_row.append(number)
        self._arrays = self._label_array = None
        return first

    def place(self, materials: Iterable[tuple[int, Material]]) -> None:
        """Replace materials that vary over time, given with their rows; free if they are the same objects as before."""
        for row, material in materials:
            if material is not self.materials[row]:
                self.materials[row], self.flags[row] = material, flags_of(material)
                self._arrays = None

    @property
    def glass_iors(self) -> list[float]:
        """Distinct indices of refraction of glass, in order of appearance."""
        glass = (each for each, flags in zip(self.materials, self.flags, strict=True) if flags & GLASS)
        return list(dict.fromkeys(material.ior for material in glass))

    @property
    def any_coverage(self) -> bool:
        """Whether some material ever has partial coverage or is unseen, so that rays may pass a surface."""
        return any(self.may_pass)

    @property
    def varies_coverage(self) -> bool:
        """Whether coverage of some material varies over time, so that rays of labels pass it at some times only."""
        return bool(self._opacity_tracks)

    @property
    def any_extended(self) -> bool:
        """Whether some material ever has extended lobes."""
        return self.possible_flags & EXTENDED != 0

    @property
    def any_emission(self) -> bool:
        """Whether some material is ever emissive."""
        return self.possible_flags & EMITS != 0

    def arrays(self) -> MaterialArrays:
        """Return the device arrays."""
        if self._arrays is None:
            self._arrays = self._upload()
        return self._arrays

    def arrays_at(self, seconds: float) -> MaterialArrays:
        """Return the device arrays with the materials whose coverage varies as they are at a time (s)."""
        here = [(row, self.materials[row]) for row in self._opacity_tracks]
        tracks = self._opacity_tracks.values()
        then = [(row, each.applied(a, each.moment(seconds))) for (row, a), each in zip(here, tracks, strict=True)]
        arrays = self.arrays()
        if then == here:
            return arrays
        try:
            self.place(then)
            return self._upload()
        finally:
            self.place(here)
            self._arrays = arrays

    def label_of_row(self) -> Any:
        """Return the number in `labels` of each row, i32 [n], on the device."""
        if self._label_array is None:
            self._label_array = upload(np.array(self._label_of_row, np.int32))
        return self._label_array

    def _upload(self) -> MaterialArrays:
        columns = EXTENDED_COLUMNS if self.any_extended else VALUE_COLUMNS
        values = np.zeros((len(self.materials), columns), np.float32)
        info = np.zeros((len(self.materials), INFO_COLUMNS), np.int32)
        lookups: list[list[float]] = []
        glass_iors = self.glass_iors
        for row, material in enumerate(self.materials):
            flags = self.flags[row]
            info[row, FLAGS], info[row, FIRST_LOOKUP] = flags, len(lookups)
            lookups += self._constants(values, row, material, INPUTS)
            if material.normal is not None:
                lookups.append(_lookup_row(material.normal, NORMAL, self._first_texture[row]))
            info[row, LOOKUP_COUNT] = len(lookups) - info[row, FIRST_LOOKUP]
            if material.lobes is not None:
                further = self._constants(values, row, material.lobes, EXTENDED_INPUTS)
                info[row, EXTENDED_LOOKUP_COUNT] = len(further)
                lookups += further
            values[row, THRESHOLD] = material.opacity_threshold
            values[row, IOR] = material.ior
            if flags & GLASS:
                info[row, GLASS_INDEX] = glass_iors.index(material.ior)
        return MaterialArrays(
            upload(values), upload(info), upload(np.array(lookups, np.float32).reshape(-1, LOOKUP_COLUMNS))
        )

    def _constants(
        self, values: Any, row: int, inputs: Material | ExtendedLobes, names: Iterable[tuple[str, int]]
    ) -> list[list[float]]:
        """Write the constant inputs to a row of `values`. Return the lookups of the others."""
        lookups = []
        for name, column in names:
            value = getattr(inputs, name)
            if isinstance(value, TextureLookup):
                lookups.append(_lookup_row(value, column, self._first_texture[row]))
            else:
                constant = np.atleast_1d(np.asarray(value, np.float32))
                values[row, column : column + len(constant)] = constant
        return lookups


def _lookup_row(lookup: TextureLookup, column: int, first_texture: int) -> list[float]:
    a, b, _, c, d, _ = lookup.uv_transform
    channel = CHANNELS.index(lookup.channel)
    pairs = zip(lookup.scale[:3], lookup.bias[:3], strict=True)
    if column == NORMAL and all(abs(scale) == 2.0 and scale == -2.0 * bias for scale, bias in pairs):
        channel = UNIT_NORMAL
    texture = lookup.texture if lookup.texture == VERTEX_COLORS else first_texture + lookup.texture
    row = [texture, channel, *lookup.scale, *lookup.bias, *lookup.uv_transform]
    return [*row, column, abs(a * d - b * c), lookup.uv_set, VERTEX_FACTORS.index(lookup.vertex_factor)]
