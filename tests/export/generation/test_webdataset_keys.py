# SPDX-License-Identifier: Apache-2.0
"""WebDataset: keys are unique over a data set, and webdataset reads shards of several scenarios together."""

import gc
import random

import numpy as np
import pytest

from tests.export.fake_stream import FakeStream
from tests.export.folders import contents
from tests.export.generation.test_recipe import RECIPE
from tiscene.export import webdataset_shards
from tiscene.export.array_files import resolved
from tiscene.export.exporter import provenance
from tiscene.export.generation.generator import finish, generate
from tiscene.export.generation.recipe import Recipe
from tiscene.export.manifest import Manifest, buffer_digest
from tiscene.export.packing import ExportRun, GroupFrames, pieces_file

FRAMES, COUNT = 2, 2


@pytest.fixture(scope="module")
def recipe():
    settings = {"width": 12, "height": 8, "buffers": ["instance", "forward_flow"], "camera": ["Main", "Sofa"]}
    change = {"scenes": ["room_02"], "settings": settings, "format": "webdataset", "frames": FRAMES}
    return Recipe.from_json(RECIPE | change)


@pytest.fixture(scope="module")
def made(recipe, tmp_path_factory):
    folder = tmp_path_factory.mktemp("webdataset") / "data"
    return generate(recipe, folder, COUNT)


def shuffled(shards):
    webdataset = pytest.importorskip("webdataset")
    data = webdataset.WebDataset(shards, shardshuffle=len(shards), seed=1).shuffle(100, rng=random.Random(1))
    return list(data.decode())


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # webdataset does not close its files
def test_webdataset_shuffles_and_decodes_shards_of_all_scenarios_and_cameras(made):
    samples = shuffled(sorted(map(str, made.folder.rglob("shard-*.tar"))))
    gc.collect()  # here, where warnings of it are ignored
    keys = [sample["__key__"] for sample in samples]
    assert keys != sorted(keys)
    found = {}
    for key, sample in zip(keys, samples, strict=True):
        assert key not in found
        assert sample["json"]["index"] == int(key.rpartition("/")[2])
        found[key] = {name: buffer_digest(np.asarray(sample[f"{name}.npy"])) for name in ("instance", "forward_flow")}
    expected = {}
    for number in range(COUNT):
        manifest = Manifest.load(made.scenario_folder(number))
        for index, entry in manifest.frames.items():
            for name, digest in entry["buffers"].items():
                camera, _, buffer = name.rpartition("/")
                expected.setdefault(f"{number:06d}/{camera}/{index:09d}", {})[buffer] = digest
    assert found == expected


@pytest.mark.slow
def test_interrupted_and_sharded_data_sets_have_the_bytes_of_one_run(recipe, made, tmp_path):
    def interrupt(number, frame):
        if (number, frame) == (1, FRAMES - 1):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        generate(recipe, tmp_path / "interrupted", COUNT, progress=interrupt)
    generate(recipe, tmp_path / "interrupted", COUNT)
    for shard in (1, 0):
        generate(recipe, tmp_path / "sharded", COUNT, shard=(shard, 2))
    finish(tmp_path / "sharded")
    assert contents(tmp_path / "interrupted") == contents(tmp_path / "sharded") == contents(made.folder)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("camera", ["Cam.v2 é", "x" * 200])
def test_names_of_cameras_may_have_dots_and_be_long(tmp_path, camera):
    stream = FakeStream(("depth",))
    (pieces,) = resolved(pieces_file(0, webdataset_shards.pieces(stream[0], {"index": 0}, stream))).values()
    (tmp_path / "0.bin").write_bytes(pieces)
    run = ExportRun(provenance(stream, "webdataset", None, "000003"), {}, [0])
    webdataset_shards.pack(GroupFrames({0: tmp_path / "0.bin"}, f"000003/{camera}/"), run, tmp_path)
    (sample,) = shuffled([str(tmp_path / "shard-000000.tar")])
    gc.collect()
    assert sample["__key__"] == f"000003/{camera}/000000000"
    np.testing.assert_array_equal(sample["depth.npy"], stream[0].depth)
