# SPDX-License-Identifier: Apache-2.0
"""Every format is read back by the library that owns it, and has the arrays of the frames."""

import base64
import io
import json
import os
import warnings
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from tests.export import fake_stream
from tests.export.fake_stream import FRAMES, FakeStream
from tiscene.errors import MissingExtra
from tiscene.export import FORMATS, Format, export, register_format
from tiscene.export.coco import rle, runs_of_objects
from tiscene.export.kitti_flow import kitti
from tiscene.frame.object_table import ObjectTable
from tiscene.scene.camera import Camera


@pytest.fixture
def cv2(monkeypatch):
    monkeypatch.setitem(os.environ, "OPENCV_IO_ENABLE_OPENEXR", "1")
    return pytest.importorskip("cv2")


def test_opencv_reads_single_part_exr(exported, cv2):
    folder, frames = exported("exr-single")
    for frame in frames:
        for name in ("depth", "position", "instance", "forward_flow", "forward_occlusion"):
            pixels = cv2.imread(str(folder / name / f"{frame.index:06d}.exr"), cv2.IMREAD_UNCHANGED)
            assert pixels is not None
            buffer = frame[name]
            if buffer.ndim == 2:
                np.testing.assert_array_equal(pixels.astype(buffer.dtype), buffer)
            else:
                np.testing.assert_array_equal(pixels[..., ::-1][..., : buffer.shape[2]], buffer)


def test_opencv_reads_kitti_flow(exported, cv2):
    folder, frames = exported("kitti-flow")
    for frame in frames:
        name = f"{frame.index:06d}_10.png"
        flow = cv2.imread(str(folder / "flow_occ" / name), cv2.IMREAD_UNCHANGED)[..., ::-1]
        assert flow.dtype == np.uint16
        assert (flow[..., 2] == 1).all()
        decoded = (flow[..., :2].astype(np.float64) - 2**15) / 64.0
        assert np.abs(decoded - frame.forward_flow).max() <= 0.5 / 64.0
        visible = cv2.imread(str(folder / "flow_noc" / name), cv2.IMREAD_UNCHANGED)[..., ::-1]
        np.testing.assert_array_equal(visible[..., 2] == 1, ~frame.forward_occlusion)
        np.testing.assert_array_equal(cv2.imread(str(folder / "image_2" / name))[..., ::-1], frame.rgb)
    for frame in frames[1:]:
        second = cv2.imread(str(folder / "image_2" / f"{frame.index - 1:06d}_11.png"))
        np.testing.assert_array_equal(second[..., ::-1], frame.rgb)


def test_flow_beyond_kittis_range_is_not_valid():
    flow = np.array([[[511.98, 0.0], [512.0, 0.0], [-512.0, 3.0], [-513.0, 0.0], [np.inf, 0.0]]], np.float32)
    np.testing.assert_array_equal(kitti(flow)[0, :, 2], [1, 0, 1, 0, 0])


@pytest.mark.parametrize("seed", range(4))
def test_runs_of_masks_are_those_of_pycocotools(seed):
    mask = pytest.importorskip("pycocotools.mask")
    random = np.random.default_rng(seed)
    instance = np.kron(random.integers(0, 4, (5, 7)), np.ones((4, 6), int)).astype(np.int32)
    found = runs_of_objects(instance)
    assert set(found) == set(np.unique(instance)) - {0}
    for id, (counts, box) in found.items():
        expected = mask.encode(np.asfortranarray(instance == id, dtype=np.uint8))
        assert rle(counts) == expected["counts"].decode()
        assert list(box) == mask.toBbox(expected).tolist()


@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")  # of pycocotools with NumPy 2
def test_pycocotools_reads_masks_and_tracks(exported):
    coco = pytest.importorskip("pycocotools.coco")
    folder, frames = exported("coco")
    read = coco.COCO(str(folder / "annotations" / "instances.json"))
    assert [each["file_name"] for each in read.loadImgs(read.getImgIds())] == [
        f"images/{frame.index:06d}.png" for frame in frames
    ]
    assert min(read.anns) == 1
    assert {category["name"] for category in read.cats.values()} == {"chair", "table"}
    for frame in frames:
        (annotation,) = read.loadAnns(read.getAnnIds(imgIds=[frame.index + 1]))
        np.testing.assert_array_equal(read.annToMask(annotation), frame.instance == 3)
        assert (annotation["track_id"], annotation["category_id"], annotation["iscrowd"]) == (3, 1, 0)
        assert annotation["area"] == (frame.instance == 3).sum()
        y, x = np.nonzero(frame.instance == 3)
        assert annotation["bbox"] == [x.min(), y.min(), np.ptp(x) + 1, np.ptp(y) + 1]
    tracks = json.loads((folder / "annotations" / "instances.json").read_text())
    assert tracks["tracks"] == [{"id": 3, "category_id": 1, "video_id": 1}]
    assert tracks["videos"][0]["length"] == FRAMES


def test_panoptic_segments_are_things_and_one_for_each_kind_of_stuff_and_the_rest_is_void(tmp_path, monkeypatch):
    kinds = {1: (12, "wall"), 2: (5, "chair"), 3: (12, "wall"), 4: (5, "chair"), 5: (0, "")}
    rows = [replace(fake_stream.CHAIR, id=id, category_id=kind[0], category=kind[1]) for id, kind in kinds.items()]
    monkeypatch.setattr(fake_stream, "ObjectTable", lambda *_: ObjectTable(rows, fake_stream.ChairMeasurements()))
    stream = FakeStream(("rgb", "instance"))
    stream.categories = {0: "", 5: "chair", 12: "wall"}
    export(stream, tmp_path, format="coco", frames=[0])
    instance = stream[0].instance
    assert set(np.unique(instance)) == set(range(6))
    expected = np.array([0, 1, 2, 1, 4, 0])[instance]
    panoptic = json.loads((tmp_path / "annotations" / "panoptic.json").read_text())
    (annotation,) = panoptic["annotations"]
    picture = np.asarray(Image.open(tmp_path / "panoptic" / annotation["file_name"])).astype(int)
    np.testing.assert_array_equal(picture @ [1, 256, 65536], expected)
    found = {segment["id"]: (segment["category_id"], segment["area"]) for segment in annotation["segments_info"]}
    assert found == {id: (kinds[id][0], (expected == id).sum()) for id in (1, 2, 4)}
    assert [each["isthing"] for each in panoptic["categories"]] == [1, 0]
    instances = json.loads((tmp_path / "annotations" / "instances.json").read_text())
    assert [each["instance"] for each in instances["annotations"]] == [2, 4]
    assert [each["id"] for each in instances["tracks"]] == [2, 4]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # webdataset does not close its files
def test_webdataset_reads_samples(exported):
    webdataset = pytest.importorskip("webdataset")
    folder, frames = exported("webdataset")
    samples = list(webdataset.WebDataset(str(folder / "shard-000000.tar"), shardshuffle=False).decode("rgb8"))
    assert [sample["__key__"] for sample in samples] == [f"{frame.index:09d}" for frame in frames]
    for frame, sample in zip(frames, samples, strict=True):
        np.testing.assert_array_equal(sample["rgb.png"], frame.rgb)
        for name in set(frame) - {"rgb"}:
            assert sample[f"{name}.npy"].dtype == frame[name].dtype
            np.testing.assert_array_equal(sample[f"{name}.npy"], frame[name])
        assert sample["json"]["index"] == frame.index
        assert sample["json"]["objects"][0]["name"] == "chair"


def test_hugging_face_reads_the_folder_with_its_types(exported, tmp_path_factory, monkeypatch):
    datasets = pytest.importorskip("datasets")
    buffers = ("rgb", "instance", "depth", "forward_flow", "forward_occlusion", "coverage")
    folder, frames = exported("parquet", buffers)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        cache = str(tmp_path_factory.mktemp("cache"))
        table = datasets.load_dataset(str(folder), cache_dir=cache)["train"]
    assert type(table.features["rgb"]).__name__ == "Image"
    assert table.features["forward_occlusion"] == datasets.Array2D((8, 12), "bool")
    assert table.features["coverage"] == datasets.Array4D((8, 12, 6, 2), "float32")
    assert table.features["instance"] == datasets.Array2D((8, 12), "int32")
    rows = table.with_format("numpy")
    for frame, row in zip(frames, rows, strict=True):
        assert (row["index"], row["time"]) == (frame.index, frame.time)
        np.testing.assert_array_equal(row["rgb"], frame.rgb)
        for name in buffers[1:]:
            np.testing.assert_array_equal(row[name], frame[name])
        assert json.loads(row["labels"])["objects"][0]["id"] == 3


def test_h5py_reads_blenderprocs_keys(exported):
    h5py = pytest.importorskip("h5py")
    folder, frames = exported("blenderproc")
    for frame in frames:
        with h5py.File(folder / f"{frame.index}.hdf5") as file:
            for key, name in {"colors": "rgb", "depth": "depth", "instance_segmaps": "instance"}.items():
                np.testing.assert_array_equal(file[key][()], frame[name])
                assert file[key].dtype == frame[name].dtype
            np.testing.assert_array_equal(file["class_segmaps"][()], frame.semantic)
            np.testing.assert_array_equal(file["forward_flow"][()], frame.forward_flow)
            expected = 0.5 + 0.5 * frame.normal_camera * (1.0, -1.0, -1.0)
            np.testing.assert_allclose(file["normals"][()], expected, atol=1e-6)
            (chair,) = json.loads(file["instance_attribute_maps"][()])
            assert (chair["idx"], chair["category_id"], chair["name"]) == (3, 1, "chair")


def test_mcap_reads_messages_at_the_times_of_frames(exported):
    reader = pytest.importorskip("mcap.reader")
    folder, frames = exported("mcap")
    messages = {}
    with (folder / "recording.mcap").open("rb") as file:
        for schema, channel, message in reader.make_reader(file).iter_messages():
            content = json.loads(message.data)
            messages[channel.topic, message.log_time] = schema.name, content
            assert set(content) <= {*json.loads(schema.data)["properties"], "objects", "spp", "time"}
    for frame in frames:
        time = frame.index * 40_000_000
        name, image = messages["/camera/instance", time]
        assert (name, image["encoding"], image["step"]) == ("foxglove.RawImage", "mono16", 24)
        pixels = np.frombuffer(base64.b64decode(image["data"]), "<u2").reshape(8, 12)
        np.testing.assert_array_equal(pixels, frame.instance)
        depth = np.frombuffer(base64.b64decode(messages["/camera/depth", time][1]["data"]), "<f4").reshape(8, 12)
        np.testing.assert_array_equal(depth, frame.depth)
        assert messages["/camera/calibration", time][1]["K"] == frame.camera.K.ravel().tolist()
        assert messages["/objects", time][1]["entities"][0]["id"] == "3"
        cloud = messages["/camera/points", time][1]
        points = np.frombuffer(base64.b64decode(cloud["data"]), np.uint8).reshape(-1, cloud["point_stride"])
        hit = np.isfinite(frame.position).all(axis=2)
        np.testing.assert_array_equal(points[:, :12].copy().view("<f4"), frame.position[hit])
        np.testing.assert_array_equal(points[:, 12:15], frame.rgb[hit])
        assert messages["/labels", time][1]["index"] == frame.index


def test_transform_of_mcap_is_the_pose_of_the_camera():
    from scipy.spatial.transform import Rotation

    from tiscene.export.mcap_log import _transform
    from tiscene.frame.frame import Frame, FrameCamera
    from tiscene.scene.camera import Camera

    camera = FrameCamera(Camera.look_at((1.0, 2.0, 3.0), (-2.0, 0.5, 1.0)), 8, 6)
    turn = _transform(Frame(0, 0.0, camera, {}), {})["rotation"]
    matrix = Rotation.from_quat([turn[axis] for axis in "xyzw"]).as_matrix()
    np.testing.assert_allclose(matrix, camera.world_from_camera[:3, :3], atol=1e-12)


def test_rerun_reads_ids_depth_and_boxes(exported):
    pytest.importorskip("rerun")
    from rerun.chunk import RrdReader

    buffers = ("rgb", "instance", "depth", "forward_flow")
    folder, frames = exported("rerun", buffers)
    rows = {}
    for chunk in RrdReader(folder / "recording-000000.rrd").stream():
        batch = chunk.to_record_batch()
        for place, index in enumerate(batch.column("frame").to_pylist() if "frame" in batch.schema.names else ()):
            rows[chunk.entity_path, index] = batch.slice(place, 1)
    for frame in frames:
        image = rows["/world/camera/instance", frame.index]
        form = image.column("SegmentationImage:format")[0].as_py()[0]
        assert (form["width"], form["height"]) == (12, 8)
        data = np.array(image.column("SegmentationImage:buffer")[0].as_py()[0], np.uint8)
        np.testing.assert_array_equal(data.view("<u2").reshape(8, 12), frame.instance)
        depth = rows["/world/camera/depth", frame.index].column("DepthImage:buffer")[0].as_py()[0]
        np.testing.assert_array_equal(np.array(depth, np.uint8).view("<f4").reshape(8, 12), frame.depth)
        assert image.column("time")[0].value == round(frame.time * 1e9)
        picture = rows["/world/camera/rgb", frame.index].column("EncodedImage:blob")[0].as_py()[0]
        np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(bytes(picture)))), frame.rgb)
        flow = rows["/world/camera/forward_flow", frame.index].column("Tensor:data")[0].as_py()[0]
        assert flow["shape"] == [8, 12, 2]
        np.testing.assert_array_equal(np.array(flow["buffer"], np.float32).reshape(8, 12, 2), frame.forward_flow)
        camera = rows["/world/camera", frame.index]
        pose = np.array(camera.column("Transform3D:mat3x3")[0].as_py()[0]).reshape(3, 3).T  # columns first
        np.testing.assert_array_equal(pose, frame.camera.world_from_camera[:3, :3].astype(np.float32))
        assert camera.column("Pinhole:resolution")[0].as_py() == [[12.0, 8.0]]
        boxes = rows["/world/objects", frame.index]
        assert boxes.column("Boxes3D:labels")[0].as_py() == ["chair"]
        assert boxes.column("Boxes3D:half_sizes")[0].as_py() == [[0.5, 0.5, 0.5]]


def test_mcap_and_rerun_have_no_pinhole_of_an_orthographic_camera(tmp_path):
    reader = pytest.importorskip("mcap.reader")
    pytest.importorskip("rerun")
    from rerun.chunk import RrdReader

    stream = FakeStream(("depth",))
    stream.camera = Camera(orthographic_height=2.0)
    for format in ("mcap", "rerun"):
        export(stream, tmp_path / format, format=format, frames=range(2))
    with (tmp_path / "mcap" / "recording.mcap").open("rb") as file:
        messages = [
            (channel.topic, json.loads(message.data))
            for _, channel, message in reader.make_reader(file).iter_messages()
        ]
    assert {topic for topic, _ in messages} == {"/labels", "/tf", "/objects", "/camera/depth"}
    assert {content["camera"]["projection"] for topic, content in messages if topic == "/labels"} == {"orthographic"}
    chunks = [chunk.to_record_batch() for chunk in RrdReader(tmp_path / "rerun" / "recording-000000.rrd").stream()]
    names = {name for batch in chunks for name in batch.schema.names}
    assert "Transform3D:translation" in names
    assert not any(name.startswith("Pinhole") for name in names)


def test_chunks_of_rerun_hold_several_frames_in_order(exported):
    pytest.importorskip("rerun")
    from rerun.chunk import RrdReader

    folder, frames = exported("rerun", ("depth",))
    chunks = [chunk.to_record_batch() for chunk in RrdReader(folder / "recording-000000.rrd").stream()]
    (depth,) = (batch for batch in chunks if "DepthImage:buffer" in batch.schema.names)
    assert depth.column("frame").to_pylist() == [frame.index for frame in frames]
    ids = depth.column("rerun.controls.RowId").to_pylist()
    assert ids == sorted(ids)


def test_missing_library_is_named_before_anything_is_rendered(tmp_path):
    absent = Format("absent", "tiscene.export.npz", "nothing", "nobody", extra="absent", libraries=("no_such_library",))
    register_format(absent)
    try:
        stream = FakeStream(("rgb",))
        with pytest.raises(MissingExtra, match=r"no_such_library is not installed: pip install 'tiscene\[absent\]'"):
            export(stream, tmp_path / "out", format="absent", frames=range(2))
        assert not stream.rendered
        assert not (tmp_path / "out").exists()
    finally:
        del FORMATS["absent"]


def test_listing_formats_imports_none_of_their_libraries():
    import subprocess
    import sys

    program = "import sys, tiscene.cli.parser as p; p.parser(); print(*sys.modules)"
    printed = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    libraries = {library for format in FORMATS.values() for library in format.libraries}
    assert not {*libraries, "taichi", "pxr"} & set(printed)
