# SPDX-License-Identifier: Apache-2.0
"""COCO's JSON of a split: pictures, masks and tracks of all its scenarios, with ids and names of its own."""

import errno
import io
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pycocotools.coco import COCO

from tiscene.errors import ExportError, StageWarning
from tiscene.export.coco import PACKED
from tiscene.export.generation import coco_splits
from tiscene.export.generation.coco_splits import joined
from tiscene.export.generation.data_set_index import DataSet
from tiscene.export.generation.data_set_verification import verify_data_set
from tiscene.export.generation.generator import finish, generate
from tiscene.export.generation.recipe import Recipe

FRAMES = 2
RECIPE = {
    "scenes": ["object_view", "solid_benchmark"],
    "ranges": {"objects": [1, 2], "templates": ["Cube", "Ball 01"]},
    "frames": FRAMES,
    "settings": {"width": 32, "height": 24, "quality": "fast", "spp": 1, "buffers": ["rgb", "instance"]},
    "format": "coco",
    "splits": {"train": 0.6, "val": 0.4},
}
COUNT = 4


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("coco") / "data"
    generate(Recipe.from_json(RECIPE), folder, COUNT)
    return folder


@pytest.fixture
def copied(made, tmp_path):
    shutil.copytree(made, tmp_path / "data")
    return tmp_path / "data"


def read(folder, split, name=PACKED[0]):
    return json.loads((folder / split / name).read_text())


def test_each_split_has_the_pictures_masks_and_tracks_of_all_its_scenarios(made):
    splits = {"train": 0, "val": 0}
    for number in range(COUNT):
        splits[DataSet.load(made).recipe.split(number)] += 1
    assert min(splits.values()) >= 1
    assert max(splits.values()) >= 2
    for split, count in splits.items():
        coco = COCO(made / split / PACKED[0])
        assert len(coco.imgs) == count * FRAMES
        assert [video["id"] for video in coco.dataset["videos"]] == list(range(1, count + 1))
        for annotation in coco.anns.values():
            image = coco.imgs[annotation["image_id"]]
            scenario, frame = image["file_name"].split("/images/")
            part = read(made / split, scenario)
            (same,) = [
                each
                for each in part["annotations"]
                if (each["image_id"], each["instance"]) == (1 + int(frame[:6]), annotation["instance"])
            ]
            for name in ("name", "category_id", "bbox", "area", "segmentation"):
                assert same[name] == annotation[name]
            (track,) = [each for each in coco.dataset["tracks"] if each["id"] == annotation["track_id"]]
            assert track["video_id"] == annotation["video_id"] == image["video_id"]
            assert track["category_id"] == annotation["category_id"]
        for segments in read(made, split, PACKED[1])["annotations"]:
            image = coco.imgs[segments["image_id"]]
            assert segments["file_name"] == image["file_name"].replace("images", "panoptic")
            pixels = np.asarray(Image.open(made / split / segments["file_name"])) @ (1, 256, 65536)
            ids, areas = np.unique(pixels[pixels > 0], return_counts=True)
            assert [(each["id"], each["area"]) for each in segments["segments_info"]] == list(
                zip(ids.tolist(), areas.tolist(), strict=True)
            )


def test_all_splits_have_all_categories(made):
    """Trainers number the categories of a file by their order."""
    train, val = read(made, "train")["categories"], read(made, "val")["categories"]
    assert train == val
    assert {"ball", "cube", "wall"} <= {each["name"] for each in train}
    parts = [json.loads(file.read_text())["categories"] for file in made.glob(f"*/0*/{PACKED[0]}")]
    assert any(part != train for part in parts)


def test_cameras_of_a_scenario_are_videos(copied):
    scenario = next(copied.glob("val/0*"))
    for camera in ("Main", "Sofa"):
        for name in PACKED:
            (scenario / camera / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(scenario / name, scenario / camera / name)
    for name in PACKED:
        (scenario / name).unlink()
    content = next(json.loads(b"".join(data)) for _, data in joined(copied, {"val": [scenario]}))
    assert [(each["id"], each["video_id"], each["file_name"]) for each in content["images"]] == [
        (1 + FRAMES * row + frame, 1 + row, f"{scenario.name}/{camera}/images/{frame:06d}.png")
        for row, camera in enumerate(("Main", "Sofa"))
        for frame in range(FRAMES)
    ]
    ids = [each["id"] for each in content["annotations"]]
    assert ids == list(range(1, len(ids) + 1))


def test_verification_names_what_is_not_that_of_the_scenarios_and_merge_mends_it(copied):
    assert verify_data_set(copied, sample=0).is_good
    whole = (copied / "val" / PACKED[0]).read_bytes()
    (copied / "val" / PACKED[0]).write_bytes(whole + b" ")
    (copied / "train" / PACKED[1]).unlink()
    assert set(verify_data_set(copied, sample=0).problems) == {f"val/{PACKED[0]}", f"train/{PACKED[1]}"}
    finish(copied)
    assert verify_data_set(copied, sample=0).is_good
    assert (copied / "val" / PACKED[0]).read_bytes() == whole


def test_each_file_of_a_scenario_is_read_once_and_progress_is_reported(copied, monkeypatch):
    read_bytes, read, steps = Path.read_bytes, [], []
    monkeypatch.setattr(Path, "read_bytes", lambda path: read.append(path) or read_bytes(path))
    before = {name: (copied / name).read_text() for name in (f"val/{PACKED[0]}", f"train/{PACKED[1]}")}
    finish(copied, progress=lambda task, fraction: steps.append((task, fraction)))
    files = [path for path in read if path.suffix == ".json"]
    assert sorted(files) == sorted(path for name in PACKED for path in copied.glob(f"*/0*/{name}"))
    assert steps[-len(files) :] == [("joining annotations", (k + 1) / len(files)) for k in range(len(files))]
    assert {name: (copied / name).read_text() for name in before} == before


@pytest.mark.parametrize("damage", ["{", None])
def test_damaged_part_is_named_and_keeps_what_was_there(copied, damage):
    scenario = next(copied.glob("val/0*"))
    whole = (copied / "val" / PACKED[0]).read_bytes()
    (scenario / PACKED[0]).unlink()
    if damage is not None:
        (scenario / PACKED[0]).write_text(damage)
    with pytest.raises(ExportError, match=rf"{scenario.name}.*missing or damaged: delete .*{scenario.name}', and"):
        finish(copied)
    assert (copied / "val" / PACKED[0]).read_bytes() == whole
    assert f"val/{scenario.name}" in verify_data_set(copied, sample=0).problems


def test_full_disk_is_no_damage_of_a_scenario(copied, monkeypatch):
    class FullDisk(io.BytesIO):
        def write(self, data):
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(coco_splits.tempfile, "TemporaryFile", lambda **_: FullDisk())
    with pytest.raises(ExportError, match=rf"^cannot write '{copied}': .*No space left on device$"):
        finish(copied)


def test_ids_of_several_categories_are_not_joined(copied):
    file = next(copied.glob(f"val/0*/{PACKED[0]}"))
    content = json.loads(file.read_text())
    content["categories"][0]["name"] = "robot"
    file.write_text(json.dumps(content))
    with pytest.warns(StageWarning, match=r"is '.*' in some and '.*' in others; name all categories"):
        finish(copied)
    assert not list(copied.glob(f"*/{PACKED[0]}"))
