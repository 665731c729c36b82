# SPDX-License-Identifier: Apache-2.0
"""A room with lights, lenses, points, instances, physics and animation, in any unit and axes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from pxr import Usd

from tests.usd.helpers import write
from tiscene.usd import RoomPlacement, join

ROOM = "/Home/studio"  # path of a joined room
OBJECT = 'prepend apiSchemas = ["TisceneObjectAPI", "PhysicsRigidBodyAPI", "PhysicsMassAPI"]'
RATE = "startTimeCode = 0\n    endTimeCode = 10\n    timeCodesPerSecond = 10"


def write_studio(folder: Path, meters: float, up: str) -> Path:
    """Write a room with lights, lenses, points, instances, physics and animation; its numbers are made of meters."""
    turned = up == "Z"

    def u(value: float, power: int = 1) -> str:
        return repr(value / meters**power)

    def v(x: float, y: float, z: float) -> str:
        """Return a vector below the root, which is turned to the axes of the stage."""
        return f"({u(x)}, {u(y)}, {u(z)})"

    def world(x: float, y: float, z: float) -> str:
        return v(x, -z, y) if turned else v(x, y, z)

    def at(x: float, y: float, z: float, more: str = "") -> str:
        order = '"xformOp:translate"' + (', "xformOp:rotateX"' if more else "")
        return f"double3 xformOp:translate = {v(x, y, z)}\n{more}\nuniform token[] xformOpOrder = [{order}]\n"

    (folder / "lamp.usda").write_text(f"""#usda 1.0
(
    defaultPrim = "Lamp"
)
def Xform "Lamp" {{
    def SphereLight "Bulb" {{
        float inputs:radius = {u(0.05)}
        bool inputs:normalize = 1
        float inputs:intensity = {u(0.2, 2)}
        {at(0, 0.3, 0)}
    }}
    def Cylinder "Foot" {{
        double height = {u(0.2)}
        double radius = {u(0.05)}
        uniform token axis = "Y"
    }}
    def Sphere "Knob" {{
        double radius = {u(0.08)}
        {at(0, 0.12, 0)}
    }}
}}
""")
    walls = "".join(
        f"""
    def Mesh "{name}" (prepend apiSchemas = ["SemanticsLabelsAPI:class"]) {{
        token[] semantics:labels:class = ["{name.lower()}"]
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [{", ".join(v(*point) for point in points)}]
        uniform token subdivisionScheme = "none"
    }}"""
        for name, points in {
            "Floor": [(-2, 0, -2), (-2, 0, 2), (2, 0, 2), (2, 0, -2)],
            "Ceiling": [(-2, 2.5, -2), (2, 2.5, -2), (2, 2.5, 2), (-2, 2.5, 2)],
            "Wall": [(-2, 0, -2), (2, 0, -2), (2, 2.5, -2), (-2, 2.5, -2)],
        }.items()
    )
    half_turn = math.sqrt(0.5)
    body = f"""
def Xform "Room" (
    kind = "assembly"
    prepend variantSets = "lighting"
    variants = {{
        string lighting = "day"
    }}
) {{
    double xformOp:rotateX = {90 if turned else 0}
    uniform token[] xformOpOrder = ["xformOp:rotateX"]
    variantSet "lighting" = {{
        "day" {{
            over "Panel" {{
                float inputs:intensity = {u(4, 2)}
            }}
        }}
        "night" {{
            over "Panel" {{
                float inputs:intensity.timeSamples = {{ 0: {u(0.5, 2)}, 10: {u(1.5, 2)} }}
            }}
        }}
    }}
    def PhysicsScene "Physics" {{
        float physics:gravityMagnitude = {u(3)}
    }}
    {walls}
    def RectLight "Panel" (prepend apiSchemas = ["CollectionAPI:lightLink"]) {{
        rel collection:lightLink:excludes = </Room/Dots>
        float inputs:width = {u(0.6)}
        float inputs:height = {u(0.4)}
        bool inputs:normalize = 1
        {at(0, 2.4, 0, "double xformOp:rotateX = -90")}
    }}
    def "LampA" (
        instanceable = true
        prepend payload = @./lamp.usda@
    ) {{
        {at(-1.2, 0.1, -1.2)}
    }}
    def "LampB" (
        instanceable = true
        prepend references = @./lamp.usda@
    ) {{
        double3 xformOp:translate.timeSamples = {{ 0: {v(1.2, 0.1, -1.2)}, 10: {v(1.2, 0.1, 0)} }}
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}
    def Xform "Würfel" (
        kind = "component"
        {OBJECT}
    ) {{
        vector3f physics:velocity = ({u(0.5)}, 0, 0)
        {at(0.5, 1, -0.8)}
        def Cube "Shape" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {{
            double size = {u(0.3)}
        }}
    }}
    def Xform "Pendulum" (
        kind = "component"
        {OBJECT}
    ) {{
        {at(-0.7, 1.4, -0.5)}
        def Sphere "Shape" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {{
            double radius = {u(0.12)}
        }}
    }}
    def PhysicsSphericalJoint "Hook" {{
        rel physics:body1 = </Room/Pendulum>
        point3f physics:localPos0 = {world(-0.4, 2.2, -0.5)}
        point3f physics:localPos1 = {v(0.3, 0.8, 0)}
        quatf physics:localRot0 = {(half_turn, half_turn, 0, 0) if turned else (1, 0, 0, 0)}
    }}
    def Points "Dots" {{
        point3f[] points = [{v(0.9, 0.2, 0.6)}, {v(1.1, 0.3, 0.5)}]
        float[] widths = [{u(0.2)}, {u(0.3)}]
    }}
    def BasisCurves "Wire" {{
        uniform token type = "linear"
        int[] curveVertexCounts = [3]
        point3f[] points = [{v(-1.5, 0.1, 0.8)}, {v(-1, 1, 0.6)}, {v(-0.6, 0.4, 0.9)}]
        float[] widths = [{u(0.1)}] (interpolation = "constant")
    }}
    def PointInstancer "Stones" {{
        int[] protoIndices = [0, 0]
        point3f[] positions.timeSamples = {{ 0: [{v(0, 0.1, 1)}, {v(0.4, 0.1, 1.1)}] }}
        vector3f[] velocities.timeSamples = {{ 0: [{v(0, 0.3, 0)}, {v(0, 0.2, 0)}] }}
        rel prototypes = </Room/Stones/Stone>
        def Sphere "Stone" {{
            double radius = {u(0.1)}
        }}
    }}
    def Sphere "Glass" (prepend apiSchemas = ["MaterialBindingAPI"]) {{
        double radius = {u(0.3)}
        {at(0.1, 0.9, 0.2)}
        rel material:binding = </Room/Amber>
    }}
    def Material "Amber" {{
        token outputs:mtlx:surface.connect = </Room/Amber/Surface.outputs:out>
        float inputs:depth = {u(0.1)}
        def Shader "Surface" {{
            uniform token info:id = "ND_standard_surface_surfaceshader"
            float inputs:base = 0
            float inputs:transmission = 1
            color3f inputs:transmission_color = (0.9, 0.5, 0.1)
            float inputs:transmission_depth.connect = </Room/Amber.inputs:depth>
            token outputs:out
        }}
    }}
    def Xform "Loose" (kind = "component") {{
        double3 xformOp:translate = {world(-1.4, 0.6, 0.2)}
        double xformOp:rotateX = {90 if turned else 0}
        uniform token[] xformOpOrder = ["!resetXformStack!", "xformOp:translate", "xformOp:rotateX"]
        def Cone "Shape" {{
            double height = {u(0.4)}
            double radius = {u(0.2)}
            uniform token axis = "Y"
        }}
    }}
    def Camera "Main" {{
        float focalLength = {u(0.18)}
        float horizontalAperture = {u(0.24)}
        float verticalAperture = {u(0.18)}
        float horizontalApertureOffset = {u(0.01)}
        float fStop = 1
        float focusDistance.timeSamples = {{ 0: {u(2)}, 10: {u(1)} }}
        float2 clippingRange = ({u(0.1)}, {u(20)})
        float exposure = -1
        {at(0, 1.2, 1.9, "double xformOp:rotateX = -12")}
    }}
}}"""
    return write(folder, body, meters=meters, up=up, name="studio.usda", more=f'defaultPrim = "Room"\n    {RATE}')


def write_cellar(folder: Path, meters: float = 1.0, up: str = "Y", more: str = "") -> Path:
    """Write the room whose units and axes a joined stage has."""
    body = f'def Cube "Cellar" (prepend apiSchemas = ["PhysicsCollisionAPI"])\n{{\n    double size = {0.1 / meters}\n}}'
    return write(folder, body, meters=meters, up=up, name="cellar.usda", more=f'defaultPrim = "Cellar"\n    {more}')


def joined(room: Path, place: tuple[float, float, float] = (0.0, 0.0, 0.0), yaw: float = 0.0, **cellar: Any) -> Path:
    """Join a room to a stage in other units; return its file."""
    below = (0.0, -90.0, 0.0) if cellar.get("up", "Y") == "Y" else (0.0, 0.0, -90.0)
    rooms = [(write_cellar(room.parent, **cellar), below), RoomPlacement(room, place, yaw, "studio")]
    return join(rooms, room.parent / "home.usda")


def stage_of(body: str, folder: Path, more: str = "") -> Usd.Stage:
    """Join a room in centimeters with Z up to a stage in meters with Y up; return that."""
    more = f'defaultPrim = "Room"\n    {more}'
    room = write(folder, body, name="room.usda", meters=0.01, up="Z", more=more)
    return Usd.Stage.Open(str(joined(room, (1.0, 2.0, 3.0))))
