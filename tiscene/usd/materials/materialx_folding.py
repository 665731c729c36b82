# SPDX-License-Identifier: Apache-2.0
"""Weighted lobes of a MaterialX surface (`materialx_bsdf`) as inputs of standard_surface: one material for all.

Shares of metal, glass and sheets become weights, and colors are mixed by them. What one material cannot hold is
reported in one message for each surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdShade

from tiscene.usd.core.report import StageReport
from tiscene.usd.core.shader_network import ShaderConnection, connections_of
from tiscene.usd.materials.materialx_baker import Baker
from tiscene.usd.materials.materialx_bsdf import OPAQUE, Inputs, Kind, LobeReader, WeightedLobe, given
from tiscene.usd.materials.materialx_network import MaterialXNetwork
from tiscene.usd.materials.materialx_nodes import is_geometric
from tiscene.usd.materials.materialx_signal import Signal, number

FOLDED = "ND_standard_surface_surfaceshader"  # the model of the inputs
_BETWEEN = 0.02  # mean of `_between` of a mask that is hardly more than its edges
_EQUAL = 1e-3  # largest difference between the texels of what counts as constant


def folded_inputs(
    surface: UsdShade.Shader, time: Usd.TimeCode, network: MaterialXNetwork, report: StageReport
) -> tuple[Inputs, dict[str, Signal]]:
    """Return the inputs of standard_surface that stand for a surface: connections, and computed values by name."""
    inputs = given(connections_of(surface, time))
    reader = LobeReader(network, time)
    lobes = reader.lobes(inputs.get("bsdf"))
    emission = reader.lobes(inputs.get("edf"))
    folding = _Folding(network.baker, reader.notes)
    computed = folding.inputs(lobes, emission, network.value(inputs.get("opacity"), 1.0))
    normal = folding.normal(lobes)
    if reader.notes:
        report.omission(surface.GetPath(), f"BSDFs are drawn as one material: {'; '.join(reader.notes)}")
    connections: Inputs = {"thin_walled": inputs["thin_walled"]} if "thin_walled" in inputs else {}
    if normal is not None:
        connections["normal"] = normal
    return connections, computed


class _Folding:
    def __init__(self, baker: Baker, notes: dict[str, None]) -> None:
        self._baker, self._notes = baker, notes

    def inputs(
        self, lobes: Sequence[WeightedLobe], emission: Sequence[WeightedLobe], opacity: Signal
    ) -> dict[str, Signal]:
        """Return the inputs that stand for the lobes and the emission of a surface with an opacity."""
        base = self._limited([each for each in lobes if each.kind in OPAQUE])
        if clear := [each for each in base if _is_clear(each)]:
            missing = self._weight(clear)
            base = [replace(x, weight=self._share(x.weight, [missing])) for x in base if not _is_clear(x)]
            opacity = self._baker.product(self._baker.affine(missing, -1.0, 1.0), opacity)
        coats, sheens, gloss = ([x for x in lobes if x.kind == kind] for kind in ("coat", "sheen", "gloss"))
        diffuse, metal = self._of(base, "diffuse"), self._of(base, "metal", "schlick")
        glass, sheets = self._of(base, "glass", "refraction"), self._of(base, "sheet")
        if diffuse and metal and not (glass or gloss or sheets) and self._is_faint(metal):
            reflections, reflected = self._reflections(metal)
            diffuse = [replace(each, color=self._baker.affine(each.color, 1.0 / (1.0 - reflected))) for each in diffuse]
            gloss, metal = [reflections], []
        shiny = [*metal, *glass, *gloss]
        metalness, transmission = self._weight(metal), self._weight(glass)
        sheet = self._weight(sheets)
        found = {
            "opacity": opacity,
            "base_color": self._share(self._color([*diffuse, *metal]), [transmission, sheet]),
            "metalness": metalness,
            "transmission": self._share(transmission, [metalness]),
            "transmission_color": self._mean_color(glass),
            "subsurface": self._share(sheet, [metalness, transmission]),
            "subsurface_color": self._mean_color(sheets),
            "specular": self._share(self._weight([*gloss, *glass]), [metalness]),
            "specular_color": self._mean_color(gloss),
            "coat": self._share(self._weight(coats), []),
            "sheen_color": self._share(self._color(sheens), []),
            "emission_color": self._color(emission),
            **{name: number(1.0) for name in ("base", "sheen", "emission")},
            "specular_roughness": number(0.3),
            "coat_roughness": number(0.0),
        }
        for name, several, attribute in (
            ("specular_roughness", shiny, "roughness"),
            ("specular_IOR", gloss or glass, "ior"),
            ("coat_roughness", coats, "roughness"),
            ("coat_IOR", coats, "ior"),
            ("sheen_roughness", sheens, "roughness"),
            ("diffuse_roughness", diffuse, "roughness"),
        ):
            if several:
                found[name] = self._mean(several, attribute)
        if metalness.constant is not None and metalness.constant[0] >= 1.0:
            found["specular"] = number(1.0)
        if self._of(glass, "refraction") and not gloss:
            self._notes["what refracts light reflects it as well"] = None
        if sheets:
            found["thin_walled"] = number(1.0)
        if diffuse and metal and not self._are_equal([each.color for each in (*diffuse, *metal)]):
            if self._baker.mean(self._baker.apply(_between, metalness))[0] > _BETWEEN:
                self._notes["metal and diffuse reflection share one color"] = None
        return found

    def normal(self, lobes: Sequence[WeightedLobe]) -> ShaderConnection | None:
        """Return the authored normal of the lobes; the first where they differ, which is noted."""
        coats = [each for each in lobes if each.kind == "coat"]
        maps = [_normal_map(each) for each in lobes if each.kind not in ("coat", "emission")]
        found = next((each for each in maps if each is not None), None)
        if any(not _is_same(each, found) for each in maps):
            self._notes["lobes share the first normal map"] = None
        elif any(not _is_same(_normal_map(each), found) for each in coats):
            self._notes["the coat has the normal of the surface"] = None
        return found

    @staticmethod
    def _of(lobes: Sequence[WeightedLobe], *kinds: Kind) -> list[WeightedLobe]:
        return [each for each in lobes if each.kind in kinds]

    def _limited(self, lobes: list[WeightedLobe]) -> list[WeightedLobe]:
        """Return lobes whose weights do not add up to more than 1, by their colors where they do."""
        if self._excess(lobes) <= 1.0:
            return lobes
        bright = []
        for each in lobes:
            most = max(self._baker.largest(each.color), 1e-6)
            weight, color = self._baker.affine(each.weight, most), self._baker.affine(each.color, 1.0 / most)
            bright.append(replace(each, weight=weight, color=color))
        excess = self._excess(bright)
        if excess <= 1.0:
            return bright
        self._notes["they reflect more light than falls on them, and are darkened"] = None
        return [replace(each, weight=self._baker.affine(each.weight, 1.0 / excess)) for each in bright]

    def _excess(self, lobes: Sequence[WeightedLobe]) -> float:
        """Return the largest sum of the weights; 1 for what is hardly above."""
        largest = self._baker.largest(self._weight(lobes))
        return largest if largest > 1.0 + _EQUAL else min(largest, 1.0)

    def _is_faint(self, metal: Sequence[WeightedLobe]) -> bool:
        """Return whether metals are a constant and small share, which a dielectric's reflections show better."""
        weight = self._weight(metal).constant
        return weight is not None and float(weight[0]) < 0.5

    def _reflections(self, metal: Sequence[WeightedLobe]) -> tuple[WeightedLobe, float]:
        """Return the gloss of a dielectric that reflects at normal incidence what metals do; and how much."""
        color = self._color(metal)
        most = min(max(self._baker.largest(color), 1e-6), 0.9)
        root = most**0.5
        tint, roughness = self._baker.affine(color, 1.0 / most), self._mean(metal, "roughness")
        return WeightedLobe("gloss", number(1.0), tint, roughness, number((1.0 + root) / (1.0 - root))), most

    def _weight(self, lobes: Sequence[WeightedLobe]) -> Signal:
        """Return the sum of weights."""
        return self._sum([each.weight for each in lobes]) if lobes else number(0.0)

    def _color(self, lobes: Sequence[WeightedLobe]) -> Signal:
        """Return the sum of colors times weights."""
        if not lobes:
            return number(0.0, 0.0, 0.0)
        return self._sum([self._baker.product(each.weight, each.color).of_width(3) for each in lobes])

    def _mean_color(self, lobes: Sequence[WeightedLobe]) -> Signal:
        return self._mean(lobes, "color") if lobes else number(1.0, 1.0, 1.0)

    def _mean(self, lobes: Sequence[WeightedLobe], attribute: str) -> Signal:
        """Return the mean of an attribute by weights; another than color that differs is noted."""
        values: list[Signal] = [getattr(each, attribute) for each in lobes]
        if self._are_equal(values):
            return values[0]
        if attribute != "color":
            self._notes[f"lobes share the mean of their {'roughness' if attribute == 'roughness' else 'IOR'}"] = None
        weights = [each.weight for each in lobes]
        width = max(each.width for each in values)

        def mean(*parts: NDArray[Any]) -> NDArray[Any]:
            factors, colors = parts[: len(parts) // 2], parts[len(parts) // 2 :]
            weighted = sum(a * b for a, b in zip(factors, colors, strict=True))
            return np.asarray(weighted / np.maximum(sum(factors), 1e-6))

        return self._constant(self._baker.apply(mean, *weights, *(each.of_width(width) for each in values)))

    @staticmethod
    def _are_equal(values: Sequence[Signal]) -> bool:
        first = values[0]
        return all(
            each is first
            or (
                each.constant is not None
                and first.constant is not None
                and np.array_equal(each.constant, first.constant)
            )
            for each in values
        )

    def _share(self, part: Signal, others: Sequence[Signal]) -> Signal:
        """Return a part over what the others leave."""
        several = [each for each in others if not each.is_zero]
        if not several and self._baker.largest(part) <= 1.0:
            return part

        def share(value: NDArray[Any], *taken: NDArray[Any]) -> NDArray[Any]:
            left = np.maximum(1.0 - sum(taken), 1e-6)
            return np.asarray(np.clip(value / left, 0.0, 1.0))

        return self._constant(self._baker.apply(share, part, *several))

    def _sum(self, signals: Sequence[Signal]) -> Signal:
        total = signals[0]
        for each in signals[1:]:
            factor, signal = (total, each) if total.constant is not None else (each, total)
            if factor.constant is not None:
                total = self._baker.affine(signal, 1.0, factor.constant)
            else:
                total = self._baker.apply(lambda a, b: a + b, total, each)
        return self._constant(total)

    def _constant(self, signal: Signal) -> Signal:
        """Return a computed image that is the same everywhere as a constant."""
        image = signal.image
        if image is None or (image.max(axis=(0, 1)) - image.min(axis=(0, 1))).max() > _EQUAL:
            return signal
        return Signal(constant=self._baker.mean(signal))


def _between(share: NDArray[Any]) -> NDArray[Any]:
    """Return how far a share is from all and nothing, 0..1."""
    return 4.0 * share * (1.0 - share)


def _normal_map(lobe: WeightedLobe) -> ShaderConnection | None:
    """Return the normal of a lobe; None for the mesh's own."""
    source = None if lobe.normal is None else lobe.normal.source
    return None if source is None or is_geometric(source.id) else lobe.normal


def _is_same(first: ShaderConnection | None, second: ShaderConnection | None) -> bool:
    """Return whether two normals come from the same output."""
    return (None if first is None else first.attribute.GetPath()) == (
        None if second is None else second.attribute.GetPath()
    )


def _is_clear(lobe: WeightedLobe) -> bool:
    """Return whether light passes a lobe as if it were not there."""
    signals = (lobe.ior, 1.0), (lobe.roughness, 0.0), (lobe.color, 1.0)
    is_same = all(each.constant is not None and (each.constant == value).all() for each, value in signals)
    return lobe.kind == "refraction" and is_same
