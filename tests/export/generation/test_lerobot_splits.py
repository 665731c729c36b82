# SPDX-License-Identifier: Apache-2.0
"""LeRobot's data set of a split: an episode for each scenario, with its rows, pictures and statistics."""

import json
import shutil

import numpy as np
import pytest

from tests.export.folders import contents
from tests.export.test_videos import decoded
from tiscene.errors import ExportError, StageWarning
from tiscene.export.generation import lerobot_splits
from tiscene.export.generation.data_set_verification import verify_data_set
from tiscene.export.generation.generator import finish, generate
from tiscene.export.generation.lerobot_splits import INFO, STATISTICS, VIDEO
from tiscene.export.generation.recipe import Recipe

pq = pytest.importorskip("pyarrow.parquet")
pytest.importorskip("av")

FRAMES, COUNT = 3, 5
RECIPE = Recipe.from_json({
    "scenes": ["object_view", "solid_benchmark"],
    "ranges": {"objects": 1, "templates": ["Cube"]},
    "frames": FRAMES,
    "settings": {"width": 34, "height": 23, "quality": "fast", "spp": 1},
    "format": "lerobot",
    "splits": {"train": 0.6, "val": 0.4},
    "seed": 3,
})  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lerobot") / "data"
    generate(RECIPE, folder, COUNT)
    return folder


@pytest.fixture
def copied(made, tmp_path):
    shutil.copytree(made, tmp_path / "data")
    return tmp_path / "data"


def rows(folder):
    return [row for path in sorted(folder.glob("chunk-*/*.parquet")) for row in pq.read_table(path).to_pylist()]


def pictures(folder):
    return [picture for path in sorted(folder.rglob("*.mp4")) for picture in decoded(path, "rgb24")[0]]


def own_of_split(folder, kind):
    """Return the files of a split that are not those of its scenarios."""
    return sorted(path.relative_to(folder).as_posix() for path in folder.glob(f"{kind}/**/*") if path.is_file())


def check(split, roots):
    """Compare the data set of a split with those of its episodes."""
    info = json.loads((split / INFO).read_text())
    assert (info["total_episodes"], info["total_frames"]) == (len(roots), FRAMES * len(roots))
    assert info["splits"] == {"train": f"0:{len(roots)}"}  # all splits of LeRobot's data sets are named so
    found = rows(split / "data")
    expected = [row for root in roots for row in rows(root / "data")]
    for place, (row, own) in enumerate(zip(found, expected, strict=True)):
        assert row == own | {"episode_index": place // FRAMES, "index": place}
    episodes = rows(split / "meta/episodes")
    for number, (episode, root) in enumerate(zip(episodes, roots, strict=True)):
        place = {"chunk_index": episode["data/chunk_index"], "file_index": episode["data/file_index"]}
        in_file = pq.read_table(split / info["data_path"].format(**place))["episode_index"].to_pylist()
        assert in_file.count(number) == FRAMES
        place = {name: episode[f"videos/{VIDEO}/{name}"] for name in ("chunk_index", "file_index")}
        video = decoded(split / info["video_path"].format(video_key=VIDEO, **place), "rgb24")[0]
        first, end = (round(25 * episode[f"videos/{VIDEO}/{name}_timestamp"]) for name in ("from", "to"))
        assert (np.stack(video[first:end]) == np.stack(pictures(root))).all()
        assert (episode["dataset_from_index"], episode["dataset_to_index"]) == (number * FRAMES, (number + 1) * FRAMES)
        assert (episode["length"], episode["tasks"]) == (FRAMES, ["observe the scene"])
        assert episode["stats/index/min"] == [number * FRAMES]
        assert episode["stats/index/mean"] == [(number + 0.5) * FRAMES - 0.5]
        assert episode["stats/episode_index/max"] == episode["stats/episode_index/q99"] == [number]
    check_statistics(json.loads((split / STATISTICS).read_text()), found, episodes)


def check_statistics(statistics, found, episodes):
    names = {"observation.state", "action", "timestamp", "frame_index", "episode_index", "index", "task_index"}
    assert set(statistics) == {*names, VIDEO}
    for name in names:
        column = np.array([np.ravel(row[name]) for row in found], np.float64)
        expected = {"min": column.min(0), "max": column.max(0), "mean": column.mean(0), "std": column.std(0)}
        for kind, value in expected.items():
            np.testing.assert_allclose(statistics[name][kind], value, rtol=1e-9, atol=1e-7)
        assert statistics[name]["count"] == [len(found)]
    each = [{kind: np.array(row[f"stats/{VIDEO}/{kind}"]) for kind in ("min", "mean", "std")} for row in episodes]
    mean = np.mean([one["mean"] for one in each], axis=0)
    np.testing.assert_allclose(statistics[VIDEO]["mean"], mean)
    variance = np.mean([one["std"] ** 2 + one["mean"] ** 2 for one in each], axis=0) - mean**2
    np.testing.assert_allclose(statistics[VIDEO]["std"], np.sqrt(variance))
    for feature in statistics:
        for quantile in ("q01", "q10", "q50", "q90", "q99"):
            mean = np.mean([row[f"stats/{feature}/{quantile}"] for row in episodes], axis=0)  # of equal lengths
            np.testing.assert_allclose(statistics[feature][quantile], mean)
    np.testing.assert_array_equal(statistics[VIDEO]["min"], np.min([one["min"] for one in each], axis=0))


def test_each_split_is_a_data_set_with_an_episode_for_each_scenario(made):
    counts = []
    for split in ("train", "val"):
        scenarios = sorted((made / split).glob("0*"))
        check(made / split, scenarios)
        counts.append(len(scenarios))
    assert min(counts) >= 2


def test_cameras_of_a_scenario_are_episodes(copied):
    scenario = next(copied.glob("val/0*"))
    for camera in ("Sofa", "Main"):
        for name in ("meta", "data", "videos"):
            shutil.copytree(scenario / name, scenario / camera / name)
    for name in ("meta", "data", "videos"):
        shutil.rmtree(scenario / name)
    finish(copied)
    others = sorted(copied.glob("val/0*"))[1:]
    check(copied / "val", [scenario / "Main", scenario / "Sofa", *others])


def test_large_splits_have_several_files_and_files_of_longer_ones_are_removed(copied, monkeypatch):
    scenarios = sorted((copied / "train").glob("0*"))
    with monkeypatch.context() as patch:
        patch.setattr(lerobot_splits, "MAX_ROWS", 2 * FRAMES)
        patch.setattr(lerobot_splits, "MAX_EPISODES", 2)
        patch.setattr(lerobot_splits, "MAX_VIDEO_BYTES", 1)
        patch.setattr(lerobot_splits, "FILES_PER_CHUNK", 2)
        finish(copied)
        check(copied / "train", scenarios)
        assert len(own_of_split(copied / "train", "data")) == -(-len(scenarios) // 2)
        assert own_of_split(copied / "train", "videos") == [
            f"videos/{VIDEO}/chunk-{number // 2:03d}/file-{number % 2:03d}.mp4" for number in range(len(scenarios))
        ]
        assert verify_data_set(copied, sample=0).is_good
    assert f"train/videos/{VIDEO}/chunk-000/file-001.mp4" in verify_data_set(copied, sample=0).problems
    finish(copied)
    assert len(own_of_split(copied / "train", "videos")) == 1
    assert verify_data_set(copied, sample=0).is_good


def test_shards_and_later_scenarios_give_the_bytes_of_one_run(made, tmp_path):
    generate(RECIPE, tmp_path, COUNT - 2)
    for shard in (1, 0):
        generate(RECIPE, tmp_path, COUNT, shard=(shard, 2))
    finish(tmp_path)
    assert contents(tmp_path) == contents(made)


def test_verification_names_what_is_not_that_of_the_scenarios_and_merge_mends_it(copied):
    assert verify_data_set(copied, sample=0).is_good
    (video,) = copied.glob("val/videos/**/*.mp4")
    whole = video.read_bytes()
    video.write_bytes(whole[:-1])
    (copied / "train" / STATISTICS).unlink()
    names = {video.relative_to(copied).as_posix(), f"train/{STATISTICS}"}
    assert set(verify_data_set(copied, sample=0).problems) == names
    finish(copied)
    assert video.read_bytes() == whole
    assert verify_data_set(copied, sample=0).is_good


@pytest.mark.parametrize("pattern", ["meta/info.json", "meta/episodes/*/*", "data/*/*", "videos/*/*/*"])
@pytest.mark.parametrize("damage", [b"{", None])
def test_damaged_part_is_named(copied, pattern, damage):
    scenario = next(copied.glob("val/0*"))
    (file,) = scenario.glob(pattern)
    file.unlink()
    if damage is not None:
        file.write_bytes(damage)
    with pytest.raises(ExportError, match=rf"{scenario.name}.*missing or damaged: delete .*{scenario.name}', and"):
        finish(copied)
    assert f"val/{scenario.name}" in verify_data_set(copied, sample=0).problems


def test_pictures_of_several_sizes_or_rates_are_not_joined(copied):
    file = next(copied.glob(f"val/0*/{INFO}"))
    info = json.loads(file.read_text())
    info["features"][VIDEO]["shape"] = [16, 20, 3]
    file.write_text(json.dumps(info | {"fps": 10}))
    with pytest.warns(StageWarning, match=r"no LeRobot data .*20x16 px at 10 frames .*34x24 px at 25 frames .* name"):
        finish(copied)
    assert [own_of_split(copied / "val", kind) for kind in ("meta", "data", "videos")] == [[], [], []]
    assert own_of_split(copied / "train", "meta")


def test_progress_of_joining_is_reported(copied):
    steps = []
    finish(copied, progress=lambda task, fraction: steps.append((task, fraction)))
    done = [task for task, fraction in steps if fraction == 1.0]
    assert done[0] == "reading summaries"
    assert sorted(done[1:]) == ["joining episodes of train", "joining episodes of val"]
    assert len(steps) == COUNT + 4 * COUNT


def test_lerobot_reads_a_split(made):
    """LeRobot pins most of its dependencies: run this test in an environment of its own."""
    pytest.importorskip("lerobot.datasets.lerobot_dataset")
    from lerobot.datasets.compute_stats import aggregate_stats
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    for split in ("train", "val"):
        scenarios = sorted((made / split).glob("0*"))
        data = LeRobotDataset("tiscene/test", root=made / split)
        episodes = [statistics_of(row) for row in rows(made / split / "meta/episodes")]
        for feature, kinds in aggregate_stats(episodes).items():
            assert set(kinds) == set(data.meta.stats[feature])
            for kind, value in kinds.items():
                np.testing.assert_allclose(data.meta.stats[feature][kind], value, rtol=1e-6, atol=1e-9)
        assert (len(data), data.num_episodes) == (FRAMES * len(scenarios), len(scenarios))
        expected = [picture for scenario in scenarios for picture in pictures(scenario)]
        for place, (row, picture) in enumerate(zip(data, expected, strict=True)):
            image = row[VIDEO].numpy().transpose(1, 2, 0)
            np.testing.assert_array_equal(np.round(255.0 * image), picture)
            assert divmod(place, FRAMES) == (int(row["episode_index"]), int(row["frame_index"]))
        last = LeRobotDataset("tiscene/test", root=made / split, episodes=[len(scenarios) - 1])
        np.testing.assert_array_equal(np.round(255.0 * last[0][VIDEO].numpy()).transpose(1, 2, 0), expected[-FRAMES])


def statistics_of(row):
    """Return the statistics in the row of an episode: by feature, and by kind."""
    found = {}
    for name, value in row.items():
        if name.startswith("stats/"):
            _, feature, kind = name.split("/")
            found.setdefault(feature, {})[kind] = np.array(value)
    return found
