# SPDX-License-Identifier: Apache-2.0
"""`tiscene inspect`: report the contents of a USD file, which of them are rendered, and which are not and why."""

from __future__ import annotations

import argparse
import dataclasses
import json
import re
import time
import warnings
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from tiscene.cli.show import stage_file, triangle_count
from tiscene.errors import StageError, StageWarning, counted
from tiscene.scene.description import DistantLight, DomeLight, SceneDescription
from tiscene.usd.read.inspection import StageFacts, stage_facts
from tiscene.usd.read.stage_reader import read_stage

_MAX_LISTED = 12
_USUAL_SIZE = (0.3, 200.0)  # m, of the longest side of a scene
_MAX_OFFSET = 1e4  # of the scene from the origin, in units of its longest side
_BVH_BYTES = 100  # per triangle, of BVH and packed vertices, approximately


def run(args: argparse.Namespace) -> None:
    """Print the report, as text or as JSON. It ends with a verdict, also where the stage is refused."""
    path = stage_file(args.file)
    options = {"variants": dict(args.variant), "root": args.root}
    report: dict[str, Any] = {"file": str(path)}
    say = (lambda text: None) if args.json else print
    try:
        facts = None if args.untrusted else stage_facts(path, **options)
        if facts:
            report["facts"] = dataclasses.asdict(facts)
            for line in _facts(path, facts):
                say(line)
        began = time.perf_counter()
        reading = {"taxonomy": args.taxonomy, "strict": args.strict, "subdivision": args.subdivision}
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            stage = read_stage(path, untrusted=args.untrusted, **reading, **options)
        report["seconds"] = round(time.perf_counter() - began, 3)
    except StageError as error:
        report |= {"verdict": _refusal(error), "refused": True, "problems": list(error.problems)}
        report["advice"] = error.advice
        print(json.dumps(report, indent=1, ensure_ascii=False) if args.json else f"\n{report['verdict']}")
        raise
    warned = [str(each.message) for each in caught if isinstance(each.message, StageWarning)]
    left_out = [line.strip() for text in warned for line in text.split("\n")[1:]]
    suspicious = _suspicious(stage, facts)
    report |= {"rendered": list(_rendered(stage)), "left_out": left_out, "suspicious": suspicious, "refused": False}
    report["verdict"] = _verdict(stage, left_out, suspicious)
    if args.json:
        print(json.dumps(report, indent=1, ensure_ascii=False))
        return
    print(f"\nRendered (read in {report['seconds']:.2f} s):")
    for line in report["rendered"]:
        print(f"  {line}")
    print("\nNot rendered, or not quite as authored:" if left_out else "\nNothing is left out.")
    for line in left_out:
        print(f"  {line}")
    if suspicious:
        print("\nProbably not intended:")
    for line in suspicious:
        print(f"  {line}")
    print(f"\n{report['verdict']}")


def _refusal(error: StageError) -> str:
    return f"Verdict: refused, for {counted(len(error.problems), 'problem')}."


def _verdict(stage: SceneDescription, left_out: list[str], suspicious: list[str]) -> str:
    """Return in one line whether a stream of the stage shows what its author meant."""
    if not stage.instances:
        return "Verdict: nothing to see; the stage has no geometry that is drawn."
    broken = sum(line.endswith("; left out") for line in left_out)
    others = len(left_out) - broken
    notes = [f"{counted(broken, 'kind')} of broken part left out"] if broken else []
    notes += [f"{counted(others, 'kind')} of content approximated or not drawn"] if others else []
    notes += [f"{counted(len(suspicious), 'thing')} to check"] if suspicious else []
    return f"Verdict: rendered, with {', '.join(notes)}." if notes else "Verdict: rendered as authored."


def _facts(path: Path, facts: StageFacts) -> Iterable[str]:
    """Yield the lines about the file itself."""
    unit = f"{facts.meters_per_unit:g} m per unit" + ("" if facts.unit_is_authored else " (unauthored)")
    layers = counted(len(facts.layers), "layer")
    yield f"{path}\n  {_bytes(path.stat().st_size)}, {layers}, {unit}, {facts.up_axis} up"
    for layer in facts.other_units[:_MAX_LISTED]:
        yield f"  not converted to these units by USD: {layer}"
    if len(facts.other_units) > _MAX_LISTED:
        yield f"  ... and {counted(len(facts.other_units) - _MAX_LISTED, 'more layer')} in other units"
    if facts.time_codes:
        first, last = facts.time_codes
        yield (
            f"  time codes {first:g} to {last:g}, {facts.time_codes_per_second:g} per second; "
            f"{counted(facts.animated, 'prim')} with motion"
        )
    prims = counted(sum(facts.types.values()), "prim")
    yield f"  {prims}, {facts.instances:,} of them instances{_listing(facts.types)}"
    for place, (selected, names) in list(facts.variants.items())[:_MAX_LISTED]:
        yield f"  variants {place}: {', '.join(f'[{name}]' if name == selected else name for name in names)}"
    if len(facts.variants) > _MAX_LISTED:
        yield f"  ... and {len(facts.variants) - _MAX_LISTED} more variant sets"
    yield f"  labels: {', '.join(facts.taxonomies) or 'none; names of prims are used instead'}"
    if facts.unauthored_schemes:
        meshes = counted(facts.unauthored_schemes, "mesh", "meshes")
        yield f"  {meshes} without an authored subdivisionScheme: smooth surfaces, by USD's default catmullClark"
    joints = sum(number for name, number in facts.types.items() if re.fullmatch(r"Physics\w*Joint", name))
    if facts.still_bodies and (joints or "PhysicsScene" in facts.types):
        bodies = counted(facts.still_bodies, "rigid body", "rigid bodies")
        yield f"  not simulated: {bodies}, {counted(joints, 'joint')}; bodies with TisceneObjectAPI are"
    for key, text in facts.license.items():
        line, *more = text.strip().splitlines() or [""]
        yield f"  {key}: {line}{' ...' if more else ''}"


def _rendered(stage: SceneDescription) -> Iterable[str]:
    low, high = stage.bounds()
    yield f"{' x '.join(f'{side:.3g}' for side in high - low)} m (x, y, z)"
    unique = sum(len(mesh.triangles) for mesh in stage.meshes)
    meshes, instances = counted(len(stage.meshes), "mesh", "meshes"), counted(len(stage.instances), "time")
    yield f"{counted(unique, 'triangle')} in {meshes}, placed {instances}: {triangle_count(stage):,}"
    categories = Counter(item.category or "(no category)" for item in stage.objects)
    yield f"{counted(len(stage.objects), 'object')}{_listing(dict(categories.most_common()))}"
    parts = sum(len(item.parts) or 1 for item in stage.objects)
    not_colliding = sum(not instance.collides for instance in stage.instances)
    movable = sum(item.movable for item in stage.objects)
    bodies = f"{counted(movable, 'movable object')}; {counted(not_colliding, 'mesh', 'meshes')} without collision"
    if stage.colliders:
        bodies += f"; {counted(len(stage.colliders), 'invisible collider')}"
    yield f"{counted(parts, 'part')}; {bodies}"
    deforming = [mesh for mesh in stage.meshes if mesh.deformation is not None]
    moving = sum(len(track.instances) for track in stage.tracks)
    if deforming or moving:
        animated = f"{counted(moving, 'animated mesh', 'animated meshes')} within objects"
        yield f"{counted(len(deforming), 'deforming mesh', 'deforming meshes')}; {animated}"
    varying = len(stage.material_tracks), len(stage.light_tracks)
    if any(varying):
        materials, lights = counted(varying[0], "animated material"), counted(varying[1], "light")
        yield f"{materials}; {lights} of animated size or visibility"
    pixels = sum(texture.pixels.nbytes for texture in stage.textures)
    texels = counted(len(stage.textures), "texture")
    yield f"{counted(len(stage.materials), 'material')}, {texels} of {_bytes(pixels)}"
    kinds = Counter(type(light).__name__ for light in stage.lights)
    yield f"{counted(len(stage.lights), 'light')}{_listing(dict(kinds))}"
    names = ", ".join(camera.name for camera in stage.cameras[:_MAX_LISTED])
    yield f"{counted(len(stage.cameras), 'camera')}{': ' if names else ''}{names}"
    if stage.templates:
        names = ", ".join(template.name for template in stage.templates[:_MAX_LISTED])
        yield f"{counted(len(stage.templates), 'template')}: {names}"
    arrays = [
        (each.positions, each.triangles, each.normals, each.uv, each.materials, each.second_uv, each.colors)
        for each in stage.meshes
    ]
    geometry = sum(array.nbytes for mesh in arrays for array in mesh if array is not None)
    deformed = 3 * sum(len(mesh.triangles) for mesh in deforming)  # BVHs of three frames
    yield f"about {_bytes(geometry + (unique + deformed) * _BVH_BYTES + pixels)} on the device"


def _suspicious(stage: SceneDescription, facts: StageFacts | None) -> list[str]:
    """Return a line for each property that is probably a mistake in the file or gives a poor image."""
    found: list[str] = []
    longest = float(np.max(np.diff(stage.bounds(), axis=0)))
    if stage.instances and not _USUAL_SIZE[0] <= longest <= _USUAL_SIZE[1]:
        size = f"{100 * longest:.3g} cm" if longest < 1.0 else f"{longest / 1000:.3g} km"
        unit = f"metersPerUnit is {facts.meters_per_unit:g}" if facts else "see metersPerUnit"
        unauthored = ", USD's default, since the file has none" if facts and not facts.unit_is_authored else ""
        found.append(f"the scene is {size} long ({unit}{unauthored})")
    if stage.is_dark and stage.has_lights_off:
        found.append("all lights are off or invisible, so it is dark")
    elif stage.is_dark:
        found.append("there is no light, so a white sky and a sun light it")
    if not stage.instances:
        found.append("there is no geometry to render")
    elif float(np.abs(stage.bounds()).max()) > _MAX_OFFSET * longest:
        found.append("the scene is far from the origin: move it closer, since 32-bit floats are imprecise there")
    if not stage.cameras:
        found.append("there is no camera; the default one sees all except wide grounds")
    elif longest > 0.0:
        low, high = stage.bounds()
        far = [
            c.name for c in stage.cameras if np.linalg.norm(np.subtract(c.position, (low + high) / 2)) > 20 * longest
        ]
        found += [f"camera {name} is far away from the scene" for name in far]
    for light in stage.lights:
        if isinstance(light, DistantLight) and max(light.irradiance) > 1e6:
            found.append(f"{light.name}: {max(light.irradiance):.3g} W/m² is brighter than the sun")
    if sum(isinstance(light, DomeLight) for light in stage.lights) > 1:
        found.append("there are several dome lights; their light adds up")
    return found


def _listing(counts: dict[str, int]) -> str:
    """Return counts as text: ": 3 Mesh, 1 Xform"; "" without counts."""
    listed = [f"{count:,} {name}" for name, count in list(counts.items())[:_MAX_LISTED]]
    more = [f"{len(counts) - _MAX_LISTED} more kinds"] if len(counts) > _MAX_LISTED else []
    return (": " if counts else "") + ", ".join(listed + more)


def _bytes(number: int) -> str:
    power = min(len(str(number)) - 1, 11) // 3
    return f"{number / 1000**power:.3g} {('B', 'kB', 'MB', 'GB')[power]}"
