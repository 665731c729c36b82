# SPDX-License-Identifier: Apache-2.0
"""Formats that hold videos: what is decoded has the arrays of the frames."""

import json
import math

import numpy as np
import pytest

from tests.export.fake_stream import FRAMES, FakeStream, fake_stream_for, skip_without_extra
from tiscene.errors import ExportError
from tiscene.export import export
from tiscene.export.kitti_flow import kitti
from tiscene.export.lerobot import VIDEO
from tiscene.export.png import millimeters
from tiscene.export.video import VideoWriter


def decoded(path, layout):
    import av

    with av.open(str(path)) as container:
        return [frame.to_ndarray(format=layout) for frame in container.decode(video=0)], container.streams.video[0]


def test_frame_rates_that_videos_cannot_have_are_named(tmp_path):
    skip_without_extra("video")
    stream = fake_stream_for("video")
    stream.fps = 1e-4
    with pytest.raises(ExportError, match="videos have at least one frame in 1001 s"):
        export(stream, tmp_path, format="video", frames=range(2))


def test_videos_of_one_pixel_in_width_are_refused(tmp_path):
    skip_without_extra("video")
    with VideoWriter(tmp_path / "a.mkv", 25.0, "ffv1") as video, pytest.raises(ExportError, match="width=1: "):
        video.write(np.zeros((3, 1), np.uint8))


def test_decoded_ffv1_equals_the_buffers(exported):
    pytest.importorskip("av")
    folder, frames = exported("video")
    expected = {
        "rgb": ("rgb24", lambda frame: frame.rgb),
        "instance": ("gray16le", lambda frame: frame.instance),
        "semantic": ("gray16le", lambda frame: frame.semantic),
        "forward_occlusion": ("gray", lambda frame: frame.forward_occlusion * 255),
        "depth": ("gray16le", lambda frame: millimeters(frame.depth)),
        "forward_flow": ("rgb48le", lambda frame: kitti(frame.forward_flow)),
    }
    for name, (layout, pixels) in expected.items():
        found, stream = decoded(folder / f"{name}.mkv", layout)
        assert len(found) == FRAMES
        assert stream.average_rate == 25
        for frame, picture in zip(frames, found, strict=True):
            np.testing.assert_array_equal(picture, pixels(frame))
    preview, stream = decoded(folder / "preview.mp4", "rgb24")
    assert len(preview) == FRAMES
    context = stream.codec_context
    colors = context.colorspace, context.color_range, context.color_primaries, context.color_trc
    assert colors == (6, 1, 1, 13)  # ITU-T H.273: the matrix of BT.601, studio range, the colors of sRGB


def test_video_holds_ids_of_16_bits_and_refuses_larger_ones(tmp_path):
    pytest.importorskip("av")

    class ManyIds(FakeStream):
        id = 40_000

        def __getitem__(self, index):
            frame = super().__getitem__(index)
            frame["instance"][2, 3] = self.id
            return frame

    stream = ManyIds(("instance",), width=13, height=7)
    export(stream, tmp_path / "fits", format="video", frames=range(2))
    pictures, _ = decoded(tmp_path / "fits" / "instance.mkv", "gray16le")
    assert pictures[1][2, 3] == 40_000
    stream.id = 70_000
    with pytest.raises(ExportError, match="the id 70000; this format holds ids 0"):
        export(stream, tmp_path / "large", format="video", frames=range(2))
    with pytest.raises(ExportError, match="'normal' has no form as video"):
        export(FakeStream(("normal",)), tmp_path / "normal", format="video", frames=range(2))
    assert not (tmp_path / "normal").exists()


def test_lerobot_layout_has_rows_video_and_statistics(exported):
    pq = pytest.importorskip("pyarrow.parquet")
    pytest.importorskip("av")
    folder, frames = exported("lerobot", ("rgb",))
    info = json.loads((folder / "meta" / "info.json").read_text())
    assert (info["codebase_version"], info["total_frames"], info["fps"]) == ("v3.0", FRAMES, 25)
    place = {"chunk_index": 0, "file_index": 0}
    rows = pq.read_table(folder / info["data_path"].format(**place)).to_pydict()
    assert set(rows) == set(info["features"]) - {"observation.images.rgb"}
    assert rows["frame_index"] == list(range(FRAMES))
    np.testing.assert_allclose(rows["timestamp"], [frame.time for frame in frames], rtol=1e-6)
    np.testing.assert_array_equal(rows["observation.state"][1:], rows["action"][:-1])
    video = folder / info["video_path"].format(video_key="observation.images.rgb", **place)
    assert len(decoded(video, "rgb24")[0]) == FRAMES
    (episode,) = pq.read_table(folder / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert (episode["length"], episode["dataset_to_index"], episode["tasks"]) == (FRAMES, FRAMES, ["observe the scene"])
    stats = json.loads((folder / "meta" / "stats.json").read_text())["observation.images.rgb"]
    colors = np.stack([frame.rgb for frame in frames]).reshape(-1, 3) / 255.0
    np.testing.assert_allclose(np.ravel(stats["mean"]), colors.mean(0))
    np.testing.assert_allclose(np.ravel(stats["std"]), colors.std(0))
    np.testing.assert_allclose(np.ravel(stats["min"]), colors.min(0))
    shares = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
    for name, share in shares.items():
        np.testing.assert_allclose(np.ravel(stats[name]), np.sort(colors, axis=0)[math.ceil(share * len(colors)) - 1])
        assert episode["stats/frame_index/" + name] == [math.ceil(share * FRAMES) - 1]
    assert pq.read_table(folder / "meta" / "tasks.parquet").to_pandas().loc["observe the scene", "task_index"] == 0


@pytest.mark.parametrize("size", [(12, 8), (13, 7)])
def test_lerobot_reads_its_data_set(exported, size):
    """LeRobot pins most of its dependencies: run this test in an environment of its own."""
    pytest.importorskip("lerobot.datasets.lerobot_dataset")
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    folder, frames = exported("lerobot", ("rgb",), width=size[0], height=size[1])
    data = LeRobotDataset("tiscene/test", root=folder)
    assert (len(data), data.num_episodes, data.fps) == (FRAMES, 1, 25)
    pictures = decoded(next(folder.rglob("*.mp4")), "rgb24")[0]
    poses = [np.array((*frame.camera.position, *frame.camera.rotation), np.float32) for frame in frames]
    next_poses = [*poses[1:], poses[-1]]
    rows = zip(frames, data, pictures, poses, next_poses, strict=True)
    for frame, row, picture, pose, next_pose in rows:
        np.testing.assert_array_equal(row["observation.state"].numpy(), pose)
        np.testing.assert_array_equal(row["action"].numpy(), next_pose)
        assert (int(row["frame_index"]), row["task"]) == (frame.index, "observe the scene")
        assert float(row["timestamp"]) == pytest.approx(frame.time)
        image = row["observation.images.rgb"].numpy().transpose(1, 2, 0)
        assert list(image.shape) == list(data.features["observation.images.rgb"]["shape"])
        np.testing.assert_array_equal(np.round(255.0 * image), picture)
    check_statistics(folder, frames, data)
    ahead = LeRobotDataset("tiscene/test", root=folder, delta_timestamps={"action": [0.0, 1 / 25]})
    np.testing.assert_array_equal(ahead[0]["action"].numpy(), [poses[1], poses[2]])


def check_statistics(folder, frames, data):
    """Compare the statistics with those that LeRobot computes of the pictures and rows, in 5000 bins."""
    from lerobot.datasets.compute_stats import compute_episode_stats
    from PIL import Image

    files = [str(folder / f"{frame.index}.png") for frame in frames]
    for frame, file in zip(frames, files, strict=True):
        Image.fromarray(frame.rgb).save(file)
    rows = data.hf_dataset.with_format("numpy")[:]
    computed = compute_episode_stats({VIDEO: files} | {name: rows[name] for name in rows}, data.features)
    assert set(computed) == set(data.meta.stats)
    for feature, own in computed.items():
        assert set(own) == set(data.meta.stats[feature])
        spread = (own["max"] - own["min"]).max()
        for kind, value in own.items():
            if (feature, kind) == (VIDEO, "std"):
                continue  # LeRobot 0.4 squares colors in 8 bits, which overflow
            np.testing.assert_allclose(data.meta.stats[feature][kind], value, rtol=1e-5, atol=spread / 2000 + 1e-6)
