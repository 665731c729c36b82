# SPDX-License-Identifier: Apache-2.0
"""Index, statistics and contact sheet of a data set, from the summaries of its scenarios.

They are functions of the summaries alone, so that data sets that were made in parts have the same bytes.
"""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from tiscene.errors import ArgumentError, ExportError, counted, export_errors
from tiscene.export.array_files import json_file, png
from tiscene.export.generation import coco_splits, lerobot_splits
from tiscene.export.generation.recipe import Recipe
from tiscene.export.generation.scenario_summary import FILE, THUMBNAIL, THUMBNAIL_WIDTH, read_summary
from tiscene.export.generation.split_parts import counter
from tiscene.export.manifest import Manifest
from tiscene.export.parquet import card_head
from tiscene.export.webdataset_shards import card_features
from tiscene.files import write_atomically

DATA_SET, INDEX, STATISTICS, SHEET = "dataset.json", "index.jsonl", "statistics.json", "contact_sheet.png"
CARD, MARK = "README.md", "<!-- `tiscene generate` writes this file again, unless this line is removed. -->"
ROWS = {"parquet": "data/train-*.parquet", "webdataset": "shard-*.tar"}  # by format: what Hugging Face reads
JOINED = {"coco": coco_splits, "lerobot": lerobot_splits}  # by format: what joins the scenarios of a split
MAX_THUMBNAILS = 48
GAP, TEXT = 8, 16  # px
BACKGROUND, INK = (16, 17, 21), (200, 202, 206)
Summary: TypeAlias = dict[str, Any] | None  # of a scenario; None: it is not done


@dataclass(frozen=True)
class DataSet:
    """A folder of scenarios.

    Attributes:
        folder: The folder.
        recipe: What its scenarios are drawn from.
        count: Number of scenarios.
    """

    folder: Path
    recipe: Recipe
    count: int

    def __post_init__(self) -> None:
        for name in self.recipe.splits:
            if name.casefold() in map(str.casefold, (DATA_SET, INDEX, STATISTICS, SHEET, CARD)):
                raise ArgumentError(f"recipe: splits: {name!r} is a file of the data set: choose another name")

    @classmethod
    def load(cls, folder: Path) -> DataSet | None:
        """Read `dataset.json`; None if the folder has none. Raises ExportError if it is damaged."""
        try:
            content = json.loads((folder / DATA_SET).read_text())
            return cls(folder, Recipe.from_json(content["recipe"]), int(content["count"]))
        except (FileNotFoundError, NotADirectoryError):
            return None
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ExportError(
                f"{folder / DATA_SET} is damaged: delete it, and generate again with the same recipe"
            ) from error

    def save(self) -> None:
        """Write `dataset.json`."""
        content = {"count": self.count, "recipe": self.recipe.to_json()}
        write_atomically(self.folder / DATA_SET, json_file(content))

    def scenario_folder(self, number: int) -> Path:
        """Return the folder of a scenario, in that of its split."""
        return self.folder / self.recipe.split(number) / f"{number:06d}"

    def has(self, number: int) -> bool:
        """Return whether a scenario is done."""
        return read_summary(self.scenario_folder(number)) is not None

    def has_begun(self) -> bool:
        """Return whether anything of a scenario is in the folder."""
        return any((self.folder / split).exists() for split in self.recipe.splits)

    def present(self) -> list[Path]:
        """Return the folders that are named as those of scenarios, by ascending number."""
        folders = [path for split in self.recipe.splits for path in (self.folder / split).glob("*") if path.is_dir()]
        return sorted((path for path in folders if path.name.isdecimal()), key=lambda path: int(path.name))

    def others(self) -> list[Path]:
        """Return those of `present` that are not among the scenarios of the data set."""
        return [
            path
            for path in self.present()
            if int(path.name) >= self.count or path != self.scenario_folder(int(path.name))
        ]

    def done(self) -> int:
        """Return the number of scenarios that are done."""
        return sum(1 for split in self.recipe.splits for _ in (self.folder / split).glob(f"*/{FILE}"))

    def summaries(self) -> Iterator[tuple[int, Summary]]:
        """Yield the number and the summary of each scenario; None for one that is not done."""
        for number in range(self.count):
            yield number, read_summary(self.scenario_folder(number))

    def missing(self) -> list[int]:
        """Return the numbers of the scenarios that are not done."""
        return [number for number, summary in self.summaries() if summary is None]

    def write_index(self, progress: Callable[[str, float], None] | None = None) -> None:
        """Write index, statistics, contact sheet, and what the format has beside its scenarios.

        Args:
            progress: Called with a task and the fraction of it that is done.

        Raises:
            ExportError: They cannot be written, or files of a scenario that they are made of are damaged.
        """
        step = counter("reading summaries", self.count, progress)
        summaries = []
        for each in self.summaries():
            summaries.append(each)
            step()
        done = with_frames(summaries)
        shown = (
            [done[place * len(done) // MAX_THUMBNAILS] for place in range(MAX_THUMBNAILS)]
            if len(done) > MAX_THUMBNAILS
            else done
        )
        with export_errors(self.folder):
            for name, data in index_files(summaries).items():
                write_atomically(self.folder / name, data)
            if shown:
                write_atomically(self.folder / SHEET, png(self._contact_sheet(shown)))
            card = self.folder / CARD
            if self.recipe.format in ROWS and done and (not card.exists() or MARK.encode() in card.read_bytes()):
                write_atomically(card, self._card(done).encode())
            for path, content in self.joined(done, progress):
                if content is None:
                    path.unlink(missing_ok=True)
                else:
                    write_atomically(path, content)

    def joined(
        self, numbers: Sequence[int], progress: Callable[[str, float], None] | None = None
    ) -> Iterator[tuple[Path, Iterable[bytes] | None]]:
        """Yield the files that join those of the scenarios of a split, and their contents in parts; None: no file.

        Args:
            numbers: Of the scenarios that have frames.
            progress: As of `write_index`.
        """
        if self.recipe.format in JOINED:
            splits: dict[str, list[Path]] = {}
            for number in numbers:
                splits.setdefault(self.recipe.split(number), []).append(self.scenario_folder(number))
            for name, content in JOINED[self.recipe.format].joined(self.folder, splits, progress):
                yield self.folder / name, content

    def _card(self, numbers: list[int]) -> str:
        """Return the card of Hugging Face, from the numbers of the scenarios that have frames."""
        recipe, present = self.recipe, set(map(self.recipe.split, numbers))
        splits = (name for name in recipe.splits if name in present)  # an empty one would be an error
        files = {re.sub(r"\W", "_", name): f"{name}/**/{ROWS[recipe.format]}" for name in splits}
        scenes = ", ".join(dict.fromkeys(Path(choice.scene).stem for choice in recipe.scenes))
        manifest = Manifest.load(self.scenario_folder(numbers[0])) if recipe.format == "webdataset" else None
        features = "" if manifest is None else card_features(manifest.provenance["buffers"])
        return f"""{card_head(files, features)}
{MARK}

# {counted(len(numbers), "scenario")} of {scenes}

Rendered by tiscene. Each row is a frame; frames 0 to {recipe.frames - 1} of a scenario and a camera follow each other.
`index.jsonl` has a line for each scenario, `dataset.json` the recipe that they are drawn from.
"""

    def _contact_sheet(self, numbers: list[int]) -> Any:
        """Return the thumbnails of scenarios, each above its split and number: uint8 [h, w, 3]."""
        images = [_opened(self.scenario_folder(number) / THUMBNAIL) for number in numbers]
        height = max(image.height for image in images)
        columns = min(len(images), max(1, round(math.sqrt(len(images) * 1.5))))
        rows = -(-len(images) // columns)
        size = columns * (THUMBNAIL_WIDTH + GAP) + GAP, rows * (height + TEXT + GAP) + GAP
        sheet = Image.new("RGB", size, BACKGROUND)
        draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(11)
        for place, (number, image) in enumerate(zip(numbers, images, strict=True)):
            x = GAP + place % columns * (THUMBNAIL_WIDTH + GAP)
            y = GAP + place // columns * (height + TEXT + GAP)
            sheet.paste(image, (x, y))
            draw.text((x, y + height + TEXT - 3), f"{self.recipe.split(number)} {number}", INK, font, anchor="ls")
        return np.asarray(sheet)


def _opened(thumbnail: Path) -> Image.Image:
    """Return a thumbnail. Raises ExportError if it cannot be read."""
    try:
        with Image.open(thumbnail) as image:
            return image.convert("RGB")
    except OSError as error:
        text = f"{str(thumbnail)!r} is missing or damaged: delete {str(thumbnail.parent)!r}, and generate again"
        raise ExportError(text) from error


def with_frames(summaries: Iterable[tuple[int, Summary]]) -> list[int]:
    """Return the numbers of the scenarios that have frames: they are done, without an error."""
    return [number for number, summary in summaries if summary is not None and "error" not in summary]


def index_files(summaries: Iterable[tuple[int, Summary]]) -> dict[str, bytes]:
    """Return the contents of index and statistics by name of the file, from numbers and summaries of scenarios."""
    statistics = _Statistics()
    lines = []
    for _, summary in summaries:
        if summary is not None:
            lines.append(json.dumps(summary, separators=(",", ":")))
            statistics.add(summary)
    return {INDEX: ("\n".join(lines) + "\n").encode(), STATISTICS: json_file(statistics.result())}


class _Statistics:
    """Sums over scenarios."""

    def __init__(self) -> None:
        self._splits: Counter[str] = Counter()
        self._scenes: Counter[str] = Counter()
        self._visible: Counter[str] = Counter()
        self._sizes: Counter[int] = Counter()
        self._measures: dict[str, list[float]] = {}
        self._frames = self._failed = 0

    def add(self, summary: dict[str, Any]) -> None:
        """Add a scenario."""
        if "error" in summary:
            self._failed += 1
            return
        self._splits[summary["split"]] += 1
        self._scenes[summary["scene"]] += 1
        self._frames += summary["frames"]
        self._visible.update(summary["visible"])
        self._sizes.update({int(step): count for step, count in summary["sizes"].items()})
        for name, value in ({"mean_flow": summary["mean_flow"]} | summary["difficulty"]).items():
            if isinstance(value, int | float):
                self._measures.setdefault(name, []).append(value)

    def result(self) -> dict[str, Any]:
        """Return the statistics as JSON values."""
        measures = {}
        for name, values in self._measures.items():
            low, median, high = np.percentile(values, (5, 50, 95)).tolist()
            measures[name] = {"mean": float(np.mean(values)), "p5": low, "median": median, "p95": high}
        return {
            "scenarios": self._splits.total(),
            "failed": self._failed,
            "frames": self._frames,
            "scenarios_by_split": dict(sorted(self._splits.items())),
            "scenarios_by_scene": dict(sorted(self._scenes.items())),
            "visible_objects_by_category": dict(sorted(self._visible.items())),
            "visible_objects_by_size": {f"2^-{step}": self._sizes[step] for step in sorted(self._sizes)},
            "measures": measures,
        }
