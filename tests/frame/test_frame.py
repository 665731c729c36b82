# SPDX-License-Identifier: Apache-2.0
import copy
import pickle
from dataclasses import fields

import numpy as np
import pytest

from tiscene.errors import BufferNotFound
from tiscene.frame.frame import Frame, FrameCamera
from tiscene.scene.camera import Camera

CAMERA = Camera.look_at((1.0, 2.0, 3.0), (0.0, 0.5, 0.0), vertical_fov=1.0)


def make_frame() -> Frame:
    buffers = {"rgb": np.zeros((6, 8, 3), np.uint8), "instance": np.ones((6, 8), np.int32)}
    return Frame(index=12, time=0.48, camera=FrameCamera(CAMERA, 8, 6), buffers=buffers, categories={1: "chair"})


def test_buffers_are_attributes() -> None:
    frame = make_frame()
    assert frame.rgb is frame.buffers["rgb"]
    frame.instance[0, 0] = 7
    assert frame.buffers["instance"][0, 0] == 7
    assert "instance" in dir(frame)
    assert hasattr(frame, "rgb")
    assert not hasattr(frame, "depth")
    assert repr(frame) == "<Frame 12 at 0.480 s, 8x6: rgb, instance>"


def test_frame_is_a_mapping_of_its_buffers() -> None:
    frame = make_frame()
    assert frame["rgb"] is frame.rgb
    assert list(frame) == list(frame.keys()) == ["rgb", "instance"]
    assert len(frame) == 2
    assert "instance" in frame
    assert "depth" not in frame
    assert frame.get("depth") is None
    assert dict(frame)["instance"] is frame.instance
    with pytest.raises(KeyError, match="Ask for it: Stream"):
        frame["depth"]
    assert frame == frame
    assert frame != make_frame()
    assert len({frame, frame}) == 1


def test_buffer_that_was_not_rendered_says_how_to_ask_for_it() -> None:
    with pytest.raises(BufferNotFound) as caught:
        _ = make_frame().depth
    assert str(caught.value) == (
        "no buffer 'depth' in frame 12. Ask for it: Stream(..., buffers=('rgb', 'instance', 'depth'))."
    )


def test_unknown_buffer_suggests_the_nearest_name() -> None:
    with pytest.raises(BufferNotFound, match=r"no buffer 'forward_flw'\. Did you mean 'forward_flow'\?"):
        _ = make_frame().forward_flw


def test_frame_can_be_copied_and_pickled() -> None:
    frame = make_frame()
    for twin in (copy.copy(frame), copy.deepcopy(frame), pickle.loads(pickle.dumps(frame))):
        assert twin.index == 12
        np.testing.assert_array_equal(twin.instance, frame.instance)
        assert twin.categories == {1: "chair"}
        assert len(twin.objects) == 0


def test_error_of_a_property_is_not_hidden_by_one_about_a_buffer() -> None:
    class Broken(Frame):
        @property
        def wrong(self) -> int:
            return self.camera.nothing  # type: ignore[attr-defined, no-any-return]

    broken = Broken(**{each.name: getattr(make_frame(), each.name) for each in fields(Frame)})
    with pytest.raises(AttributeError, match="'FrameCamera' object has no attribute 'nothing'"):
        _ = broken.wrong
    assert not hasattr(broken, "wrong")


def test_camera_projects_as_opencv() -> None:
    camera = make_frame().camera
    assert camera.position == CAMERA.position
    assert camera.rotation == CAMERA.rotation
    np.testing.assert_allclose(camera.K, [[camera.K[0, 0], 0, 3.5], [0, camera.K[0, 0], 2.5], [0, 0, 1]])
    assert camera.K[0, 0] == pytest.approx(3.0 / np.tan(0.5))
    np.testing.assert_allclose(camera.K_at(0.5)[:2, 2], (4.0, 3.0))
    np.testing.assert_allclose(camera.camera_from_world @ camera.world_from_camera, np.eye(4), atol=1e-12)
    x, y, z, _ = camera.camera_from_world @ (0.0, 0.5, 0.0, 1.0)  # what the camera looks at
    assert (x, y) == pytest.approx((0.0, 0.0), abs=1e-12)
    assert z == pytest.approx(np.linalg.norm(np.subtract((1, 2, 3), (0, 0.5, 0))))
