# SPDX-License-Identifier: Apache-2.0
"""The methods of SAILenv's Agent that read and edit lights.

A light is named by one of `Agent.lights_names`. A getter returns None for an unknown name; both getters and setters
then print an error, or raise it if the agent is strict.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from tiscene.sailenv.agent_base import AgentBase
from tiscene.sailenv.json_messages import rounded, single_precision
from tiscene.sailenv.light_controls import LightControls

Result = TypeVar("Result")


class AgentLights(AgentBase):
    """Base of Agent: its methods for lights. Positions and directions are in Unity's space."""

    def get_light_color(self, light_name: str) -> tuple[int, int, int] | None:
        """Return a light's color, 8-bit sRGB."""
        return self._light("getting light color", lambda lights: lights.color(light_name))

    def set_light_color(self, light_name: str, r: int, g: int, b: int) -> None:
        """Set a light's color, 8-bit sRGB."""
        self._set_light("color", light_name, lambda: (r, g, b))

    def get_light_position(self, light_name: str) -> tuple[float, float, float] | None:
        """Return a light's position, m."""
        return self._light("getting light position", lambda lights: single_precision(lights.position(light_name)))

    def set_light_position(self, light_name: str, position: Any) -> None:
        """Set a light's position, m."""
        self._set_light("position", light_name, lambda: single_precision(position))

    def get_light_direction(self, light_name: str) -> tuple[float, float, float] | None:
        """Return the direction in which a light emits."""
        return self._light("getting light direction", lambda lights: single_precision(lights.direction(light_name)))

    def set_light_direction(self, light_name: str, direction: Any) -> None:
        """Set the direction in which a light emits."""
        self._set_light("direction", light_name, lambda: single_precision(direction))

    def get_light_intensity(self, light_name: str) -> float | None:
        """Return a light's intensity; 1 is that of the scene."""
        return self._light("getting light intensity", lambda lights: rounded(lights.intensity(light_name)))

    def set_light_intensity(self, light_name: str, intensity: float) -> None:
        """Set a light's intensity; 1 is that of the scene."""
        self._set_light("intensity", light_name, lambda: rounded(intensity))

    def get_light_indirect_multiplier(self, light_name: str) -> float | None:
        """Return the factor of a light's indirect light; 1 is that of the scene."""
        return self._light(
            "getting light indirect multiplier", lambda lights: rounded(lights.indirect_multiplier(light_name))
        )

    def set_light_indirect_multiplier(self, light_name: str, indirect_multiplier: float) -> None:
        """Set the factor of a light's indirect light; 1 is that of the scene."""
        self._set_light("indirect_multiplier", light_name, lambda: rounded(indirect_multiplier))

    def get_light_type(self, light_name: str) -> str | None:
        """Return "Directional", "Point", "Rectangle", "Disc" or "Area"."""
        return self._light("getting light type", lambda lights: lights.type(light_name))

    def _light(self, task: str, call: Callable[[LightControls], Result]) -> Result | None:
        result: Result | None = self._try(f"Error {task}: ", lambda world, _: call(world.lights))
        return result

    def _set_light(self, quantity: str, name: str, value: Callable[[], Any]) -> None:
        task = f"setting light {quantity.replace('_', ' ')}"
        self._try(f"Error {task}: ", lambda world, camera: world.set_light(camera, quantity, name, value()))
