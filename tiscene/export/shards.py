# SPDX-License-Identifier: Apache-2.0
"""Parts of an export that several processes or machines write, each into a folder of its own.

Shard i of n has the i-th of n runs of consecutive frames. Beside the usual manifest its folder has `shard.json`: which
shard it is, the frames of all shards, and the machine. `merging` makes one export of the folders.
"""

from __future__ import annotations

import hashlib
import json
import platform
from dataclasses import asdict, dataclass, field
from importlib import metadata
from pathlib import Path

from tiscene.errors import ArgumentError, ExportError
from tiscene.export.array_files import json_file
from tiscene.files import write_atomically

SHARDS, FILE = "shards", "shard.json"


@dataclass(frozen=True)
class Shard:
    """A part of an export.

    Attributes:
        number: Of the shard, from 0.
        count: Number of shards.
        frames: All frames of the export, of all shards: start, stop, step.
        machine: What rendered bytes depend on beside the manifest (see `machine`).
    """

    number: int
    count: int
    frames: tuple[int, int, int]
    machine: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.count < 1 or not 0 <= self.number < self.count:
            raise ArgumentError(f"shard {self.number}/{self.count}: must be 0/N to {max(0, self.count - 1)}/N")

    @property
    def all_frames(self) -> range:
        """The frames of all shards."""
        return range(*self.frames)

    @property
    def own_frames(self) -> range:
        """The frames of this shard."""
        frames = self.all_frames
        first, end = (len(frames) * number // self.count for number in (self.number, self.number + 1))
        return frames[first:end]

    def folder(self, output: str | Path) -> Path:
        """Return the folder of this shard in the folder of the export."""
        return Path(output) / SHARDS / f"{self.number:05d}-of-{self.count:05d}"

    def save(self, folder: Path) -> None:
        """Write `shard.json`."""
        write_atomically(folder / FILE, json_file(asdict(self)))

    @classmethod
    def load(cls, folder: Path) -> Shard | None:
        """Read `shard.json`; None if there is none.

        Raises:
            ExportError: The file is damaged.
        """
        try:
            content = json.loads((folder / FILE).read_text())
            return cls(content["number"], content["count"], tuple(content["frames"]), content["machine"])
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ExportError(f"{folder / FILE} is damaged: render that shard again") from error


def machine() -> dict[str, str]:
    """Return what the bytes of frames depend on beside the scenario and the settings.

    Versions of the libraries that compute, the C library, and a digest of the processor's features.
    """
    libraries = {name: metadata.version(name) for name in ("numpy", "taichi", "pyoidn", "usd-core")}
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        flags = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    except OSError:
        flags = platform.processor()
    return libraries | {
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "libc": " ".join(platform.libc_ver()),
        "processor": hashlib.sha256(flags.encode()).hexdigest()[:12],
    }
