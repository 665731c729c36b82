# SPDX-License-Identifier: Apache-2.0
"""`tiscene inspect`: what is in a USD file, what of it is rendered, what is not and why."""

from __future__ import annotations

import argparse
import time
import warnings
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from tiscene.cli.show import stage_file
from tiscene.errors import StageWarning
from tiscene.scene.description import DistantLight, DomeLight, SceneDescription
from tiscene.usd.read.inspection import StageFacts, stage_facts
from tiscene.usd.read.stage_reader import read_stage

_SHOWN = 12
_ROOM = (0.3, 200.0)  # m, of the longest side of what somebody would stream
_FAR = 1e4  # times as far from the origin as it is large
_TREE_BYTES = 100  # of the tree and the packed vertices, about, for each triangle


def run(args: argparse.Namespace) -> None:
    """Print it."""
    path = stage_file(args.file)
    options = {"variants": dict(args.variant), "root": args.root}
    if not args.untrusted:
        _print_facts(path, stage_facts(path, **options))
    began = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        stage = read_stage(path, untrusted=args.untrusted, taxonomy=args.taxonomy, **options)
    seconds = time.perf_counter() - began
    print(f"\nRendered (read in {seconds:.2f} s):")
    for line in _rendered(stage):
        print(f"  {line}")
    told = [str(each.message) for each in caught if isinstance(each.message, StageWarning)]
    print("\nNot rendered, or not quite as authored:" if told else "\nNothing is left out.")
    for text in told:
        print("\n".join(text.split("\n")[1:]))
    doubts = _doubts(stage, None if args.untrusted else stage_facts(path, **options))
    if doubts:
        print("\nIs this meant?")
    for line in doubts:
        print(f"  {line}")


def _print_facts(path: Path, facts: StageFacts) -> None:
    unit = f"{facts.meters_per_unit:g} m a unit" + ("" if facts.unit_is_authored else " (unauthored)")
    print(f"{path}\n  {_bytes(path.stat().st_size)}, {_count(len(facts.layers), 'layer')}, {unit}, {facts.up_axis} up")
    if facts.time_codes:
        first, last = facts.time_codes
        print(
            f"  time codes {first:g} to {last:g}, {facts.time_codes_per_second:g} a second; "
            f"{_count(facts.animated, 'prim')} with motion"
        )
    prims = _count(sum(facts.types.values()), "prim")
    print(f"  {prims}, {facts.instances:,} of them instances{_listing(facts.types)}")
    for place, (chosen, names) in list(facts.variants.items())[:_SHOWN]:
        print(f"  variants {place}: {', '.join(f'[{name}]' if name == chosen else name for name in names)}")
    if len(facts.variants) > _SHOWN:
        print(f"  ... and {len(facts.variants) - _SHOWN} more variant sets")
    print(f"  labels: {', '.join(facts.taxonomies) or 'none, so that names stand for them'}")
    for key, text in facts.license.items():
        line, *more = text.strip().splitlines() or [""]
        print(f"  {key}: {line}{' ...' if more else ''}")


def _rendered(stage: SceneDescription) -> Iterable[str]:
    low, high = stage.bounds()
    yield f"{' x '.join(f'{side:.3g}' for side in high - low)} m (x, y, z)"
    unique = sum(len(mesh.triangles) for mesh in stage.meshes)
    placed = sum(len(stage.meshes[instance.mesh].triangles) for instance in stage.instances)
    meshes, instances = _count(len(stage.meshes), "mesh", "es"), _count(len(stage.instances), "time")
    yield f"{unique:,} triangles in {meshes}, placed {instances}: {placed:,}"
    categories = Counter(thing.category or "(no category)" for thing in stage.objects)
    yield f"{_count(len(stage.objects), 'thing')}{_listing(dict(categories.most_common()))}"
    parts = sum(len(thing.parts) or 1 for thing in stage.objects)
    passed = sum(not instance.collides for instance in stage.instances)
    movable = sum(thing.movable for thing in stage.objects)
    bodies = f"{_count(movable, 'movable thing')}; {_count(passed, 'mesh', 'es')} that nothing hits"
    if stage.colliders:
        bodies += f"; {_count(len(stage.colliders), 'collider')} that nobody sees"
    yield f"{_count(parts, 'part')}; {bodies}"
    deforming = [mesh for mesh in stage.meshes if mesh.deformation is not None]
    moving = sum(len(track.instances) for track in stage.tracks)
    if deforming or moving:
        alone = f"{_count(moving, 'mesh', 'es')} that move in their things"
        yield f"{_count(len(deforming), 'mesh', 'es')} that deform; {alone}"
    pixels = sum(texture.pixels.nbytes for texture in stage.textures)
    texels = _count(len(stage.textures), "texture")
    yield f"{_count(len(stage.materials), 'material')}, {texels} of {_bytes(pixels)}"
    kinds = Counter(type(light).__name__ for light in stage.lights)
    yield f"{_count(len(stage.lights), 'light')}{_listing(dict(kinds))}"
    names = ", ".join(camera.name for camera in stage.cameras[:_SHOWN])
    yield f"{_count(len(stage.cameras), 'camera')}{': ' if names else ''}{names}"
    if stage.templates:
        yield f"{_count(len(stage.templates), 'template')}: {', '.join(each.name for each in stage.templates[:_SHOWN])}"
    arrays = [
        (each.positions, each.triangles, each.normals, each.uv, each.materials, each.second_uv, each.colors)
        for each in stage.meshes
    ]
    geometry = sum(array.nbytes for mesh in arrays for array in mesh if array is not None)
    again = 3 * sum(len(mesh.triangles) for mesh in deforming)  # trees for three frames
    yield f"about {_bytes(geometry + (unique + again) * _TREE_BYTES + pixels)} on the device"


def _doubts(stage: SceneDescription, facts: StageFacts | None) -> list[str]:
    """What is likely a mistake in the file, or makes a poor picture."""
    doubts: list[str] = []
    longest = float(np.max(np.diff(stage.bounds(), axis=0)))
    if stage.instances and not _ROOM[0] <= longest <= _ROOM[1]:
        size = f"{100 * longest:.3g} cm" if longest < 1.0 else f"{longest / 1000:.3g} km"
        said = f"metersPerUnit is {facts.meters_per_unit:g}" if facts else "see metersPerUnit"
        unauthored = ", USD's default: the file does not say" if facts and not facts.unit_is_authored else ""
        doubts.append(f"everything together is {size} long ({said}{unauthored})")
    if stage.is_dark:
        doubts.append("there is no light: the picture will be black (a DomeLight is enough)")
    if not stage.instances:
        doubts.append("there is nothing to see")
    elif float(np.abs(stage.bounds()).max()) > _FAR * longest:
        doubts.append("everything is far from the origin: numbers of 32 bits blur it, so move it nearer")
    if not stage.cameras:
        doubts.append("there is no camera: the default one sees all of the stage")
    elif longest > 0.0:
        low, high = stage.bounds()
        far = [
            c.name for c in stage.cameras if np.linalg.norm(np.subtract(c.position, (low + high) / 2)) > 20 * longest
        ]
        doubts += [f"camera {name} is far away from everything" for name in far]
    suns = [light for light in stage.lights if isinstance(light, DistantLight)]
    doubts += [
        f"{sun.name}: {max(sun.irradiance):.3g} W/m² is brighter than the sun"
        for sun in suns
        if max(sun.irradiance) > 1e6
    ]
    if sum(isinstance(light, DomeLight) for light in stage.lights) > 1:
        doubts.append("there are several domes: their light adds up")
    return doubts


def _listing(counts: dict[str, int]) -> str:
    """ ": 3 Mesh, 1 Xform", "" of nothing."""
    shown = [f"{count:,} {name}" for name, count in list(counts.items())[:_SHOWN]]
    more = [f"{len(counts) - _SHOWN} more kinds"] if len(counts) > _SHOWN else []
    return (": " if counts else "") + ", ".join(shown + more)


def _count(number: int, name: str, plural: str = "s") -> str:
    return f"{number:,} {name}{'' if number == 1 else plural}"


def _bytes(number: int) -> str:
    power = min(len(str(number)) - 1, 11) // 3
    return f"{number / 1000**power:.3g} {('B', 'kB', 'MB', 'GB')[power]}"
