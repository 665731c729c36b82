# SPDX-License-Identifier: Apache-2.0
"""Hugging Face's `datasets` reads data sets by their cards, with their splits and all values."""

import numpy as np
import pytest

from tests.export.generation.test_recipe import RECIPE
from tiscene.export.generation.generator import generate
from tiscene.export.generation.recipe import Recipe
from tiscene.export.manifest import Manifest, buffer_digest

COUNT = 4


@pytest.mark.filterwarnings("ignore")  # of datasets
def test_hugging_face_reads_a_data_set_with_its_splits_and_another_card_stays(tmp_path):
    datasets = pytest.importorskip("datasets")
    pytest.importorskip("pyarrow")
    change = {"scenes": ["object_view"], "format": "parquet", "splits": {"train": 0.5, "held-out": 0.5, "never": 1e-9}}
    data_set = generate(Recipe.from_json(RECIPE | change), tmp_path / "data", COUNT)
    read = datasets.load_dataset(str(tmp_path / "data"), cache_dir=str(tmp_path / "cache"))
    expected = {"train": [], "held_out": []}
    for number in range(COUNT):
        manifest = Manifest.load(data_set.scenario_folder(number))
        digests = [entry["buffers"]["instance"] for entry in manifest.frames.values()]
        expected[data_set.recipe.split(number).replace("-", "_")] += digests
    rows = {split: [buffer_digest(np.array(row, np.int32)) for row in read[split]["instance"]] for split in read}
    assert rows == expected
    assert all(expected.values())
    (tmp_path / "data" / "README.md").write_text("mine")
    data_set.write_index()
    assert (tmp_path / "data" / "README.md").read_text() == "mine"


@pytest.mark.filterwarnings("ignore")  # of datasets
def test_hugging_face_reads_shards_whose_first_samples_lack_values_of_later_ones(tmp_path):
    """A cube has no parts, a ball has: the type of an empty list was guessed, and no text fitted it."""
    datasets = pytest.importorskip("datasets")
    if not hasattr(datasets, "Json"):
        pytest.skip("datasets before 4.8 may lack the feature")
    ball = {"scene": "object_view", "ranges": {"templates": ["Ball 01"]}}
    settings = {"width": 12, "height": 8, "buffers": ["rgb", "instance", "forward_flow", "forward_occlusion"], "spp": 1}
    change = {"scenes": ["object_view", ball], "settings": settings, "format": "webdataset", "objects": "all"}
    recipe = Recipe.from_json(RECIPE | change | {"splits": {"train": 1}, "frames": 2, "seed": 6})
    assert [[each.template for each in recipe.scenario(number).objects] for number in (0, 1)] == [["Cube"], ["Ball 01"]]
    data_set = generate(recipe, tmp_path / "data", 2)
    rows = datasets.load_dataset(str(tmp_path / "data"), cache_dir=str(tmp_path / "cache"))["train"]
    assert rows["__key__"] == [f"{number:06d}/{frame:09d}" for number in (0, 1) for frame in (0, 1)]
    parts = [[each["parts"] for each in row["json"]["objects"] if each["template"]] for row in rows]
    assert [bool(each) for (each,) in parts] == [False, False, True, True]
    for place, row in enumerate(rows):
        entry = Manifest.load(data_set.scenario_folder(place // 2)).frames[place % 2]
        for name, dtype in (("instance", np.int32), ("forward_flow", np.float32), ("forward_occlusion", np.bool_)):
            assert buffer_digest(np.array(row[f"{name}.npy"], dtype)) == entry["buffers"][name]
        assert buffer_digest(np.asarray(row["rgb.png"])) == entry["buffers"]["rgb"]
