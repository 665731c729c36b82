# SPDX-License-Identifier: Apache-2.0
"""LeRobot's data set of a split: each scenario is an episode of it, as LeRobot expects.

`LeRobotDataset("name", root="data/train")` reads `train/meta`, `train/data` and `train/videos`, which are as those of
one export, see `tiscene.export.lerobot`. Episodes are the scenarios by ascending number; with several cameras each
camera's is one, by name. Quantiles of a split are means of those of its episodes, weighted by their lengths, as LeRobot
computes them. Videos are joined without being encoded again. LeRobot keeps each file open that it has read from; so
there are few large ones.
"""

from __future__ import annotations

import io
import itertools
import json
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from tiscene.errors import StageWarning
from tiscene.export.array_files import json_file
from tiscene.export.generation.split_parts import counter, reading
from tiscene.export.lerobot import FILES_PER_CHUNK, PLACE, QUANTILES, VIDEO
from tiscene.export.video import frame_rate

INFO, STATISTICS, TASKS = "meta/info.json", "meta/stats.json", "meta/tasks.parquet"
DATA, EPISODES, VIDEOS = f"data/{PLACE}.parquet", f"meta/episodes/{PLACE}.parquet", f"videos/{VIDEO}/{PLACE}.mp4"
NUMBERED = tuple(f"{name}/chunk-*/file-*" for name in ("data", "meta/episodes", f"videos/{VIDEO}"))
ALL = (*NUMBERED, INFO, STATISTICS, TASKS)
MAX_ROWS = 1 << 20  # of a file of `data`, about 100 MB
MAX_EPISODES = 1000  # of a file of `meta/episodes`
MAX_VIDEO_BYTES = 100 << 20  # of a file of `videos`, which is in memory until it is written


@dataclass
class _Episode:
    """An episode of a split.

    Attributes:
        number: Its number in the split.
        root: The folder of its own data set: that of a scenario, or of a camera in it.
        first: The index of its first frame in the split.
        length: Number of its frames.
        data: The number of its file of `data`.
        video: The number of its file of `videos`.
        video_frame: The number of its first frame in the video.
    """

    number: int
    root: Path
    first: int
    length: int
    data: int = 0
    video: int = 0
    video_frame: int = 0


def joined(
    folder: Path, splits: Mapping[str, Sequence[Path]], progress: Callable[[str, float], None] | None = None
) -> Iterator[tuple[str, Sequence[bytes] | None]]:
    """Yield the names of the files of each split, and their contents, of which one at a time is in memory.

    None in place of contents for files that are not of the split: those of an earlier, longer one, and all where
    pictures differ in size or rate, with a StageWarning.

    Args:
        folder: Folder of the data set.
        splits: Folders of the scenarios, by split.
        progress: Called with a task and the fraction of it that is done.

    Raises:
        ExportError: A file of a scenario is missing or damaged.
    """
    for name, scenarios in splits.items():
        roots = [root for scenario in scenarios for root in _roots(scenario)]
        split = _Split(folder, roots, counter(f"joining episodes of {name}", 4 * len(roots), progress))
        made = set()
        if split.difference:
            warnings.warn(StageWarning(
                f"{str(folder / name)!r} is no LeRobot data set of all its scenarios: {split.difference}; name width, "
                "height and fps in the recipe's settings, and generate again"
            ), stacklevel=2)  # fmt: skip
        else:
            for file, content in split.files():
                made.add(folder / name / file)
                yield f"{name}/{file}", [content]
        for path in sorted(path for pattern in ALL for path in (folder / name).glob(pattern)):
            if path not in made:
                yield path.relative_to(folder).as_posix(), None


def _roots(scenario: Path) -> list[Path]:
    """Return the folders of the data sets of a scenario, one for each camera."""
    return sorted(path.parents[1] for path in scenario.glob(f"**/{INFO}")) or [scenario]


class _Split:
    """Makes the files of a split.

    Args:
        folder: Of the data set.
        roots: The folders of the data sets of its episodes.
        step: Called four times for each of them.

    Attributes:
        difference: How pictures differ between scenarios, as a sentence; "": they do not.
    """

    def __init__(self, folder: Path, roots: Sequence[Path], step: Callable[[], None]) -> None:
        self._folder, self._step = folder, step
        self._episodes: list[_Episode] = []
        self._info: dict[str, Any] = {}  # of the first one
        self._total = 0
        pictures: dict[str, str] = {}
        for root in roots:
            with reading(folder, root / INFO):
                info = json.loads((root / INFO).read_bytes())
                height, width, _ = info["features"][VIDEO]["shape"]
                shown = f"{width}x{height} px at {info['fps']:g} frames per second"
                pictures.setdefault(shown, f"the pictures of {root.relative_to(folder).as_posix()!r} are {shown}")
                self._episodes.append(_Episode(len(self._episodes), root, self._total, info["total_frames"]))
            self._total += self._episodes[-1].length
            self._info = self._info or info
            step()
        self.difference = ", ".join(list(pictures.values())[:2]) if len(pictures) > 1 else ""

    def files(self) -> Iterator[tuple[str, bytes]]:
        """Yield the files, `info.json` last."""
        yield from self._data()
        yield from self._videos()
        total: dict[str, _FeatureStatistics] = {}
        yield from self._tables_of_episodes(total)
        tasks = self._episodes[0].root / TASKS
        with reading(self._folder, tasks):
            content = tasks.read_bytes()
        yield TASKS, content
        yield STATISTICS, json_file({feature: each.result() for feature, each in total.items()})
        count = len(self._episodes)
        totals = {"total_episodes": count, "total_frames": self._total, "splits": {"train": f"0:{count}"}}
        yield INFO, json_file(self._info | totals)

    def _data(self) -> Iterator[tuple[str, bytes]]:
        """Yield the files of rows, one for each frame."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        for number, batch in enumerate(_batches(self._episodes, lambda episode: episode.length, MAX_ROWS)):
            tables = []
            for episode in batch:
                with reading(self._folder, file := episode.root / _name(DATA)):
                    table = pq.read_table(file)
                    for column, first in (("episode_index", episode.number), ("index", episode.first)):
                        place = table.schema.get_field_index(column)
                        table = table.set_column(place, column, pa.array(table[column].to_numpy() + first))
                    tables.append(table)
                episode.data = number
                self._step()
            yield _name(DATA, number), _parquet(pa.concat_tables(tables))

    def _videos(self) -> Iterator[tuple[str, bytes]]:
        """Yield the files of pictures."""
        number = 0
        for _, alike in itertools.groupby(self._episodes, self._decoder_settings):
            for batch in _batches(
                alike, lambda episode: (episode.root / _name(VIDEOS)).stat().st_size, MAX_VIDEO_BYTES
            ):
                yield _name(VIDEOS, number), self._video(batch, number)
                number += 1

    def _decoder_settings(self, episode: _Episode) -> bytes | None:
        """Return what a decoder must know of a video; one file has one such."""
        import av

        with reading(self._folder, file := episode.root / _name(VIDEOS)), av.open(str(file)) as container:
            settings: bytes | None = container.streams.video[0].codec_context.extradata
            return settings

    def _video(self, episodes: Sequence[_Episode], number: int) -> bytes:
        """Return the video of some episodes, one after another, from the packets of theirs."""
        import av

        content = io.BytesIO()
        rate, frames, target = frame_rate(self._info["fps"]), 0, None
        with av.open(content, "w", format="mp4", options={"fflags": "+bitexact"}) as output:
            for episode in episodes:
                episode.video, episode.video_frame = number, frames
                with reading(self._folder, file := episode.root / _name(VIDEOS)), av.open(str(file)) as container:
                    source: Any = container.streams.video[0]
                    if target is None:
                        target = output.add_stream_from_template(source)
                        target.time_base = source.time_base
                    shift = round(frames / rate / source.time_base)
                    for packet in container.demux(source):
                        if packet.pts is not None and packet.dts is not None:  # the last one is empty
                            packet.pts, packet.dts, packet.stream = packet.pts + shift, packet.dts + shift, target
                            output.mux(packet)
                frames += episode.length
                self._step()
        return content.getvalue()

    def _tables_of_episodes(self, total: dict[str, _FeatureStatistics]) -> Iterator[tuple[str, bytes]]:
        """Yield the tables of episodes, and gather their statistics by feature."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        rate = frame_rate(self._info["fps"])
        for number, batch in enumerate(_batches(self._episodes, lambda _: 1, MAX_EPISODES)):
            rows = []
            for episode in batch:
                with reading(self._folder, file := episode.root / _name(EPISODES)):
                    table = pq.read_table(file)
                    (row,) = table.to_pylist()
                    _number_on(row, episode, number, rate)
                    for feature in self._info["features"]:
                        total.setdefault(feature, _FeatureStatistics()).add(row, feature)
                rows.append(row)
                self._step()
            yield _name(EPISODES, number), _parquet(pa.Table.from_pylist(rows, schema=table.schema))


def _number_on(row: dict[str, Any], episode: _Episode, file: int, rate: Fraction) -> None:
    """Change the row of an episode of its own data set to that in the split.

    Args:
        row: Values by the name of their column.
        episode: The episode.
        file: The number of the table that has the row.
        rate: Frames per second.
    """
    row["episode_index"] = episode.number
    row["dataset_from_index"], row["dataset_to_index"] = episode.first, episode.first + episode.length
    for name, number in {"data": episode.data, f"videos/{VIDEO}": episode.video, "meta/episodes": file}.items():
        row[f"{name}/chunk_index"], row[f"{name}/file_index"] = divmod(number, FILES_PER_CHUNK)
    row[f"videos/{VIDEO}/from_timestamp"] = float(episode.video_frame / rate)
    row[f"videos/{VIDEO}/to_timestamp"] = float((episode.video_frame + episode.length) / rate)
    for column, first in (("episode_index", episode.number), ("index", episode.first)):
        for kind in ("min", "max", "mean", *QUANTILES):
            (value,) = row[f"stats/{column}/{kind}"]
            row[f"stats/{column}/{kind}"] = [value + first]


class _FeatureStatistics:
    """Statistics of a feature over all episodes, from those of each."""

    def __init__(self) -> None:
        self._count = 0
        self._low = self._high = self._mean = self._squares = np.zeros(1)  # the last: sum of squared deviations
        self._quantiles = dict.fromkeys(QUANTILES, np.zeros(1))  # their sums over all frames

    def add(self, row: Mapping[str, Any], feature: str) -> None:
        """Add those of an episode, which are in its row."""
        low, high, mean, deviation = (
            np.array(row[f"stats/{feature}/{kind}"], np.float64) for kind in ("min", "max", "mean", "std")
        )
        (count,) = row[f"stats/{feature}/count"]
        for name, total in self._quantiles.items():
            self._quantiles[name] = total + count * np.array(row[f"stats/{feature}/{name}"], np.float64)
        if not self._count:
            self._low, self._high, self._mean, self._squares = low, high, mean, count * deviation**2
            self._count = count
            return
        before, self._count = self._count, self._count + count
        difference = mean - self._mean
        self._low, self._high = np.minimum(self._low, low), np.maximum(self._high, high)
        self._squares = self._squares + count * deviation**2 + difference**2 * (before * count / self._count)
        self._mean = self._mean + difference * (count / self._count)

    def result(self) -> dict[str, list[Any]]:
        """Return the statistics by name."""
        values = {"min": self._low, "max": self._high, "mean": self._mean}
        values["std"] = np.sqrt(self._squares / self._count)
        values |= {name: total / self._count for name, total in self._quantiles.items()}
        return {name: value.tolist() for name, value in values.items()} | {"count": [self._count]}


def _batches(episodes: Iterable[_Episode], size: Callable[[_Episode], int], limit: int) -> Iterator[list[_Episode]]:
    """Yield consecutive episodes whose sizes have a sum of at most `limit`, and a larger one alone."""
    batch: list[_Episode] = []
    used = 0
    for episode in episodes:
        added = size(episode)
        if batch and used + added > limit:
            yield batch
            batch, used = [], 0
        batch.append(episode)
        used += added
    if batch:
        yield batch


def _name(pattern: str, number: int = 0) -> str:
    """Return the name of a numbered file."""
    chunk, file = divmod(number, FILES_PER_CHUNK)
    return pattern.format(chunk_index=chunk, file_index=file)


def _parquet(table: Any) -> bytes:
    """Return a table as Parquet."""
    import pyarrow.parquet as pq

    content = io.BytesIO()
    pq.write_table(table, content, compression="snappy")
    return content.getvalue()
