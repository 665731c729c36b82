# SPDX-License-Identifier: Apache-2.0
"""The rooms: sizes, free flight space, published cameras, and what the variants change."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdPhysics, UsdSemantics, UsdShade

import usd_scenes
from docs.tools import gallery
from usd_scenes.author.room import LIGHTING
from usd_scenes.author.templates import APPEARANCES

PACKAGE = Path(usd_scenes.__file__).parent
ROOTS = {"object_view": "ObjectView", **gallery.ROOTS}
ROOMS = {  # m, along x and z
    "room_01": (4.5, 4.0),
    "room_02": (8.0, 7.0),
    "room_03": (3.0, 2.5),
    "room_04": (3.6, 4.0),
    "room_05": (1.8, 6.0),
}
ALL = [pytest.param(name, marks=pytest.mark.slow) if name == "home_01" else name for name in ROOTS]
AIR = {  # lower and upper corner of the space that must stay free
    "room_01": ((-1.4, 0.70, -0.9), (0.25, 2.3, 1.1)),
    "room_02": ((-2.6, 0.80, -4.6), (0.4, 2.4, -1.2)),
    "room_03": ((-0.65, 0.60, -0.3), (0.6, 2.2, 0.9)),
    "room_04": ((-1.0, 0.95, -1.1), (0.4, 2.2, 1.4)),
    "room_05": ((-0.3, 0.60, -1.9), (0.45, 2.2, 2.2)),
}


def open_scene(name: str, **choices: str) -> Usd.Stage:
    root = Sdf.Layer.CreateAnonymous(".usda")
    root.subLayerPaths.append(str(PACKAGE / name / "scene.usda"))
    stage = Usd.Stage.Open(root)
    prim = stage.GetPrimAtPath(f"/{ROOTS[name]}")
    for variant_set, choice in choices.items():
        prim.GetVariantSets().SetSelection(variant_set, choice)
    assert not stage.GetCompositionErrors()
    return stage


def prims(stage: Usd.Stage) -> list[Usd.Prim]:
    return list(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()))


def labeled(stage: Usd.Stage) -> dict[str, str]:
    every = {str(p.GetPath()): UsdSemantics.LabelsAPI(p, "class").GetLabelsAttr() for p in prims(stage)[1:]}
    return {path: attribute.Get()[0] for path, attribute in every.items() if attribute and attribute.Get()}


def boxes(stage: Usd.Stage) -> dict[str, Gf.Range3d]:
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.default_])
    return {path: cache.ComputeWorldBound(stage.GetPrimAtPath(path)).ComputeAlignedRange() for path in labeled(stage)}


@pytest.mark.parametrize("name", ROOMS)
def test_room_has_documented_size_and_many_categories(name: str) -> None:
    stage = open_scene(name)
    size = boxes(stage)[f"/{ROOTS[name]}/Building/Floor"].GetSize()
    np.testing.assert_allclose((size[0], size[2]), ROOMS[name], atol=0.02)
    assert len(set(labeled(stage).values())) >= 25
    distinct: dict[int, int] = {}
    for prim in prims(stage):
        if prim.IsA(UsdGeom.Mesh):
            mesh = UsdGeom.Mesh(prim)
            shape = hash(np.asarray(mesh.GetPointsAttr().Get()).tobytes())
            distinct[shape] = int((np.asarray(mesh.GetFaceVertexCountsAttr().Get()) - 2).sum())
    assert sum(distinct.values()) < 800_000


@pytest.mark.parametrize("name", AIR)
def test_flight_space_of_room_is_free(name: str) -> None:
    stage = open_scene(name)
    air = Gf.Range3d(*(Gf.Vec3d(*corner) for corner in AIR[name]))
    for path, box in boxes(stage).items():
        overlap = Gf.Range3d.GetIntersection(air, box)
        if not overlap.IsEmpty() and min(overlap.GetSize()) > 0.0:
            assert path.startswith(f"/{ROOTS[name]}/Building/"), path


@pytest.mark.parametrize("name", ROOMS)
def test_objects_stay_inside_the_room(name: str) -> None:
    """Nothing extends below the floor or beyond the walls."""
    low, high = boxes(open_scene(name))[f"/{ROOTS[name]}/Building/Floor"].GetMin(), (9.0, 9.0, 9.0)
    for path, box in boxes(open_scene(name)).items():
        if "/Building/" not in path:
            assert box.GetMin()[1] > -0.003, path
            assert box.GetMin()[0] > low[0] - 0.4, path
            assert box.GetMax()[1] < high[1], path


@pytest.mark.parametrize(
    ("name", "camera", "position", "pitch", "yaw"),
    [("room_02", "SAILenv", (-1.5, 2.0, 0.5), 18.0, -12.0), ("room_01", "SAILenv", (-1.3, 2.0, 1.5), 22.0, 144.0)],
)
def test_cameras_of_published_scripts_exist(
    name: str, camera: str, position: tuple[float, float, float], pitch: float, yaw: float
) -> None:
    """Published positions and angles are in Unity's axes: z forward, pitch down, yaw to the right."""
    stage = open_scene(name)
    frame = UsdGeom.Camera(stage.GetPrimAtPath(f"/{ROOTS[name]}/Cameras/{camera}")).GetCamera(0)
    x, y, z = position
    np.testing.assert_allclose(frame.frustum.position, (x, y, -z), atol=1e-9)
    down, right = np.radians(pitch), np.radians(yaw)
    forward = (np.sin(right) * np.cos(down), -np.sin(down), -np.cos(right) * np.cos(down))
    np.testing.assert_allclose(frame.frustum.ComputeViewDirection(), forward, atol=1e-6)
    vertical = 2.0 * np.degrees(np.arctan(frame.verticalAperture / 2.0 / frame.focalLength))
    assert vertical == pytest.approx(60.0, abs=1e-4)


@pytest.mark.parametrize("name", ALL)
def test_every_scene_has_an_agent_camera_and_a_light_besides_domes(name: str) -> None:
    stage = open_scene(name)
    assert stage.GetPrimAtPath(f"/{ROOTS[name]}/Cameras/Agent").IsA(UsdGeom.Camera)
    assert any(prim.HasAPI(UsdLux.LightAPI) and not prim.IsA(UsdLux.DomeLight) for prim in prims(stage))


@pytest.mark.parametrize("name", ALL)
def test_lighting_variant_changes_only_lights_and_exposure(name: str) -> None:
    powers = []
    layouts = []
    for lighting in LIGHTING:
        stage = open_scene(name, lighting=lighting)
        lights = [prim for prim in prims(stage) if prim.HasAPI(UsdLux.LightAPI) and not prim.IsA(UsdLux.PortalLight)]
        values = [
            (UsdLux.LightAPI(p).GetIntensityAttr().Get(), *UsdLux.LightAPI(p).GetColorAttr().Get()) for p in lights
        ]
        powers.append(values)
        layouts.append(boxes(stage))
        cameras = [UsdGeom.Camera(prim) for prim in prims(stage) if prim.IsA(UsdGeom.Camera)]
        assert all(camera.GetExposureAttr().HasAuthoredValue() for camera in cameras)
    assert powers[0] != powers[1] != powers[2] != powers[0]
    assert layouts[0] == layouts[1] == layouts[2]
    stage = open_scene(name)
    default = [prim for prim in prims(stage) if prim.HasAPI(UsdLux.LightAPI) and not prim.IsA(UsdLux.PortalLight)]
    assert UsdLux.LightAPI(default[0]).GetIntensityAttr().Get() == powers[0][0][0]


@pytest.mark.parametrize("name", ALL[1:])
def test_appearance_variant_keeps_labels_and_layout(name: str) -> None:
    plain = open_scene(name)
    reference = boxes(plain)
    for appearance in APPEARANCES[1:]:
        stage = open_scene(name, appearance=appearance)
        assert labeled(stage) == labeled(plain)
        for path, box in boxes(stage).items():
            # Primitives may extend beyond their meshes: leaning pillows, leaves of plants.
            np.testing.assert_allclose(box.GetMidpoint(), reference[path].GetMidpoint(), atol=0.15, err_msg=path)
        for prim in prims(stage):
            is_shown = prim.IsA(UsdGeom.Gprim) and UsdGeom.Imageable(prim).ComputePurpose() != UsdGeom.Tokens.guide
            if is_shown and prim.GetName() != "Pane":
                material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
                surface, _, _ = material.ComputeSurfaceSource()
                textured = [each.GetBaseName() for each in surface.GetInputs() if each.HasConnectedSource()]
                assert not textured, prim.GetPath()


@pytest.mark.parametrize("name", ROOMS)
def test_primitives_appearance_has_only_gprims(name: str) -> None:
    stage = open_scene(name, appearance="primitives")
    for prim in prims(stage):
        if prim.IsA(UsdGeom.Mesh):
            assert prim.GetName().startswith("Ellipsoid"), prim.GetPath()  # no UsdGeom gprim is an ellipsoid
    walls = [path for path, label in labeled(stage).items() if label in ("wall", "tiles", "floor", "ceiling")]
    assert walls
    for path in walls:
        parts = Usd.PrimRange(stage.GetPrimAtPath(path), Usd.TraverseInstanceProxies())
        assert {prim.GetTypeName() for prim in parts if prim.IsA(UsdGeom.Gprim)} == {"Cube"}, path


@pytest.mark.parametrize("appearance", APPEARANCES)
@pytest.mark.parametrize("name", ["room_01", "room_02", "room_04"])
def test_windows_pass_light_and_block_objects(name: str, appearance: str) -> None:
    stage = open_scene(name, appearance=appearance)
    every = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.default_])
    guides = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.guide])
    windows = [path for path, label in labeled(stage).items() if label == "window"]
    portals = [prim for prim in prims(stage) if prim.IsA(UsdLux.PortalLight)]
    assert len(windows) == len(portals) > 0
    for path in windows:
        pane = stage.GetPrimAtPath(f"{path}/Pane")
        assert UsdGeom.Imageable(pane).ComputePurpose() == UsdGeom.Tokens.guide
        assert pane.HasAPI(UsdPhysics.CollisionAPI)
        frame = every.ComputeWorldBound(stage.GetPrimAtPath(path)).ComputeAlignedRange().GetSize()
        opening = guides.ComputeWorldBound(pane).ComputeAlignedRange().GetSize()
        across = int(np.argmax((opening[0], 0.0, opening[2])))
        assert opening[1] > 0.95 * frame[1]
        assert opening[across] > 0.9 * frame[across]  # the sill board is wider than the opening


@pytest.mark.parametrize("name", ["room_04", "room_05"])
def test_walls_reach_below_the_joints_of_floors(name: str) -> None:
    """No skirting covers those behind cabinets, nor the threshold of a front door: the sky would show through them."""
    found = boxes(open_scene(name))
    building = f"/{ROOTS[name]}/Building/"
    floor = found[f"{building}Floor"].GetMin()[1]
    walls = [box for path, box in found.items() if path.startswith(f"{building}Wall")]
    assert len(walls) == 4
    assert all(wall.GetMin()[1] < floor for wall in walls)


@pytest.mark.parametrize("name", ROOMS)
def test_moldings_overlap_adjacent_surfaces(name: str) -> None:
    """Touching edges would leak light."""
    stage = open_scene(name)
    box = boxes(stage)
    building = f"/{ROOTS[name]}/Building"
    width, depth = ROOMS[name]
    for molding in ("Cornice", "Skirting", "DadoRail"):
        path = f"{building}/{molding}"
        if path in box:
            size = box[path].GetSize()
            assert size[0] > width + 0.002
            assert size[2] > depth + 0.002 or molding == "DadoRail"  # the dado rail ends at a tiled wall
    if f"{building}/Cornice" in box:
        assert box[f"{building}/Cornice"].GetMax()[1] > box[f"{building}/Ceiling"].GetMin()[1] + 0.002


@pytest.mark.parametrize("name", ROOMS)
def test_domes_have_portals(name: str) -> None:
    """Without, a dome takes most samples of light in a closed room."""
    stage = open_scene(name)
    domes = [prim for prim in prims(stage) if prim.IsA(UsdLux.DomeLight)]
    assert domes
    for dome in domes:
        portals = UsdLux.DomeLight(dome).GetPortalsRel().GetTargets()
        assert portals
        assert all(stage.GetPrimAtPath(path).IsA(UsdLux.PortalLight) for path in portals)


@pytest.mark.slow
def test_table_of_labels_is_up_to_date() -> None:
    (table,) = gallery.TABLE.findall((gallery.DOCS / "scenes.md").read_text(encoding="utf-8"))
    assert table == gallery.table(), "run `python -m docs.tools.gallery table`"


def test_gallery_is_up_to_date() -> None:
    assert (gallery.DOCS / "gallery.md").read_text(encoding="utf-8") == gallery.page()
    known = {f"{picture.name}.jpg" for picture in gallery.PICTURES}
    files = {path.name: path.stat().st_size for path in gallery.IMAGES.iterdir()}
    assert set(files) <= known
    assert sum(files.values()) < 12e6
    places = {(picture.scene, picture.camera) for picture in gallery.PICTURES}
    for scene, cameras in gallery.PLACES.items():
        assert len(cameras) == 3
        assert places >= {(scene, camera) for camera in cameras}
        stage = open_scene(scene)
        for camera in cameras:
            assert stage.GetPrimAtPath(f"/{ROOTS[scene]}/Cameras/{camera}")
