# SPDX-License-Identifier: Apache-2.0
"""FreeRotation: bodies that tumble keep their energy and their angular momentum.

MuJoCo's Euler method, which suits contacts, takes the gyroscopic torque from the start of a step; energy grows. Here a
second model of the bodies alone, without gravity and contacts, is integrated by the Runge-Kutta method. The engine gets
the force that has the same effect in a step, in addition to all others.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics.rotation import rotate

Array = NDArray[np.float64]
SLOW = 0.01  # rad/s: below, the Euler method gains less than 1e-7 of the energy per second
FAST = 1.0  # rad per step: above, a step is too long for the motion
SAME = 1e-9  # relative: moments of inertia that differ by less are equal


class FreeRotation:
    """Free bodies of a model that tumble: with different moments of inertia, or an origin off the center of mass.

    Args:
        engine: The module `mujoco`.
        model: A compiled model.
        bodies: Numbers in the model of bodies with a free joint.
    """

    def __init__(self, engine: Any, model: Any, bodies: Sequence[int]) -> None:
        self._engine = engine
        chosen = [body for body in bodies if _tumbles(model, body)]
        self._rows = {body: row for row, body in enumerate(chosen)}
        spec = engine.MjSpec()
        spec.option.timestep, spec.option.gravity = model.opt.timestep, [0.0] * 3
        for body in chosen:
            made = spec.worldbody.add_body(explicitinertial=True, mass=float(model.body_mass[body]))
            made.ipos, made.iquat = model.body_ipos[body], model.body_iquat[body]
            made.inertia = model.body_inertia[body]
            made.add_freejoint()
        self._model = spec.compile()
        self._data = engine.MjData(self._model)
        joints = model.body_jntadr[chosen]
        self._positions = (model.jnt_qposadr[joints][:, None] + np.arange(7)).ravel()
        self._velocities = (model.jnt_dofadr[joints][:, None] + np.arange(6)).ravel()

    def apply(self, data: Any) -> int | None:
        """Apply the force by which each body tumbles in the next step, from half a step before to half a step after.

        Returns:
            The body that turns fastest if it is too fast for a step; else None.
        """
        if not self._rows:
            return None
        pose, motion = data.qpos[self._positions], data.qvel[self._velocities]
        spins = np.abs(motion.reshape(-1, 6)[:, 3:]).max(axis=1)
        step, own = self._model.opt.timestep, self._data
        if spins.max() < SLOW:
            data.qfrc_applied[self._velocities] = 0.0
            return None
        own.qpos, own.qvel = pose, motion
        self._engine.mj_integratePos(self._model, own.qpos, own.qvel, -0.5 * step)
        self._advance()
        change = (own.qvel - motion).reshape(-1, 6)
        change[:, :3] = 0.0
        after = self._centers(pose, motion + change.ravel(), step)
        change[:, :3] = (2.0 * self._centers(pose, motion, 0.0) - self._centers(pose, motion, -step) - after) / step
        own.qacc = change.ravel() / step
        own.qpos, own.qvel = pose, motion
        self._engine.mj_inverse(self._model, own)
        data.qfrc_applied[self._velocities] = own.qfrc_inverse
        return list(self._rows)[int(spins.argmax())] if spins.max() * step > FAST else None

    def earlier(self, body: int, pose: Array, motion: Array) -> Array:
        """Return the motion [6] that a body had half a step before it has a pose [7] and a motion, without forces."""
        row = self._rows.get(body)
        if row is None:
            return motion
        own, step, there = self._data, self._model.opt.timestep, slice(6 * row, 6 * row + 6)
        self._engine.mj_resetData(self._model, own)
        own.qpos[7 * row : 7 * row + 7], own.qvel[there] = pose, -motion  # free motion is the same backwards
        poses, before = own.qpos.copy(), np.zeros(self._model.nv)
        self._model.opt.timestep = 0.5 * step
        self._advance()
        self._model.opt.timestep = step
        before[there][3:] = -own.qvel[there][3:]
        center = self._centers(poses, before, 0.0)[row]
        turned = center - self._centers(poses, before, -step)[row]
        velocity = motion[:3] + np.cross(rotate(pose[3:], motion[3:]), center - pose[:3])
        before[there][:3] = velocity - turned / step
        return before[there]

    def _centers(self, pose: Array, motion: Array, time: float) -> Array:
        """Return the centers of mass [n, 3] after bodies have moved at constant velocities."""
        self._data.qpos = pose
        self._engine.mj_integratePos(self._model, self._data.qpos, motion, time)
        self._engine.mj_kinematics(self._model, self._data)
        return np.array(self._data.xipos[1:])

    def _advance(self) -> None:
        self._engine.mj_forward(self._model, self._data)
        self._engine.mj_RungeKutta(self._model, self._data, 4)


def _tumbles(model: Any, body: int) -> bool:
    inertia, center = model.body_inertia[body], model.body_ipos[body]
    size = float(np.sqrt(inertia.max() / model.body_mass[body]))
    return bool(np.ptp(inertia) > SAME * inertia.max() or np.abs(center).max() > SAME * size)
