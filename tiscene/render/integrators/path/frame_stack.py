# SPDX-License-Identifier: Apache-2.0
"""FrameStack: what tells apart the paths of several frames that are traced in one wavefront.

The paths of a frame follow those of the one before, in equal numbers. Images are stacked below each other, as are the
rows of the film.
"""

from typing import Any, NamedTuple

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Ints1, Template
from tiscene.device.memory import device_array, upload
from tiscene.render.view import CubeView, View


class FrameStack(NamedTuple):
    """Frames whose paths are traced together; `single` stands for one frame.

    Attributes:
        paths: Paths of a frame; 0 for one frame only.
        keys: i32 [2 + frames], `paths`, the number of instances of a frame if it is the same in all, then the key of
            each frame's random numbers.
        cameras: Device array, the rows of all views (`View.rows`); None for one frame.
        trees: i32 [paths in all], for each path -1 minus the root of its frame's tree, for `occluded`.
    """

    paths: int
    keys: Any
    cameras: Any
    trees: Any

    @classmethod
    def single(cls) -> "FrameStack":
        """Return the stack of one frame, whose key and camera kernels take as other arguments."""
        return cls(0, device_array(ti.i32, (1,)), None, None)

    @classmethod
    def of(cls, paths: int, instances: int, keys: list[int], cameras: NDArray[np.float32], roots: Any) -> "FrameStack":
        """Return a stack of frames.

        Args:
            paths: Paths of a frame.
            instances: Instances of a frame.
            keys: Key of each frame's random numbers, see `frame_key`.
            cameras: float32 [3 frames, VIEW_COLUMNS].
            roots: See `DeviceScene.frame_roots`.
        """
        trees = device_array(ti.i32, (paths * len(keys),))
        write_trees(roots, paths, trees)
        return cls(paths, upload(np.array([paths, max(instances, 1), *keys], np.int32)), upload(cameras), trees)

    def cameras_of(self, view: View | CubeView) -> Any:
        """Return the cameras as a device array: those of the view, if there is one frame only."""
        return self.cameras if self.paths else view.array()

    @property
    def arguments(self) -> tuple[Any, bool]:
        """The last arguments of kernels that tell frames apart by `frame_of` and `key_of`."""
        return self.keys, self.paths > 0


@ti.func
def frame_of(keys: Template, path: ti.i32, stacked: Template) -> ti.i32:
    """Return the number of a path's frame in the stack. keys: of the stack; stacked: static, whether there is one."""
    frame = 0
    if ti.static(stacked):
        frame = path // keys[0]
    return frame


@ti.func
def key_of(frame_key: ti.i32, keys: Template, path: ti.i32, stacked: Template) -> ti.i32:
    """Return the key of the random numbers of a path's frame: `frame_key` if there is one frame only."""
    key = frame_key
    if ti.static(stacked):
        key = keys[2 + path // keys[0]]
    return key


@ti.func
def instance_in_frame(instance: ti.i32, keys: Template, stacked: Template) -> ti.i32:
    """Return the row of an instance among those of its frame, if all frames have as many; -1 for none."""
    row = instance
    if ti.static(stacked):
        if instance >= 0:
            row = instance % keys[1]
    return row


@ti.kernel
def write_trees(roots: Ints1, paths: ti.i32, trees: Ints1):
    """Write the trees of all paths, see `FrameStack`."""
    for path in range(trees.shape[0]):
        trees[path] = -1 - roots[path // paths]
