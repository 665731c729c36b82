# SPDX-License-Identifier: Apache-2.0
"""WebDataset: tar shards of 1000 frames, `shard-000000.tar`, for sequential reading at full speed.

A sample's key is the frame's index, `000000012`, behind the camera's name where there are several, and behind the
scenario's number in a data set: `000003/Main/000000012`, unique over all samples. It has `rgb.png`, `<buffer>.npy` for
every other buffer, exactly (the usual decoders of pictures would squeeze 16-bit ids into 8 bits), and `json` with
camera, events and objects.
"""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tiscene.export.array_files import Contents, npy, png
from tiscene.export.frame_json import labels_bytes
from tiscene.frame.buffers import BUFFERS

if TYPE_CHECKING:
    from tiscene.export.packing import ExportRun, GroupFrames
    from tiscene.frame.frame import Frame
    from tiscene.stream.stream import Stream

FRAMES_PER_FILE = 1000
PACKED = ("shard-*.tar",)
READS_ONCE = True
HOLDS_LABELS = True


def pieces(frame: Frame, labels: dict[str, Any], stream: Stream) -> dict[str, Contents]:
    """Return the members of a sample by extension."""
    members: dict[str, Contents] = {"json": labels_bytes(labels)}
    for name, buffer in frame.buffers.items():
        if name == "rgb":
            members["rgb.png"] = partial(png, buffer)
        else:
            members[f"{name}.npy"] = partial(npy, buffer)
    return members


def card_features(buffers: Iterable[str]) -> str:
    """Return the features of samples for a card of Hugging Face, which guesses them from the first samples otherwise.

    Those may have null and empty lists in `json` where later ones have values.
    """
    columns: dict[str, Any] = {name: {"dtype": "string"} for name in ("__key__", "__url__")}
    columns["json"] = {"dtype": "json"}
    for name in buffers:
        if name == "rgb":
            columns["rgb.png"] = {"dtype": "image"}
        else:
            kind: Any = str(BUFFERS[name].dtype)
            for _ in BUFFERS[name].shape(1, 1):
                kind = {"list": kind}
            columns[f"{name}.npy"] = kind
    lines = "".join(f"  - {json.dumps({'name': name} | kind)}\n" for name, kind in columns.items())
    return f"dataset_info:\n  features:\n{lines}"


def pack(frames: GroupFrames, run: ExportRun, folder: Path) -> None:
    """Write one shard. Headers have no owner and no time."""
    path = folder / f"shard-{frames.first // FRAMES_PER_FILE:06d}.tar"
    with tarfile.open(path, "w", format=tarfile.PAX_FORMAT) as target:
        for frame in frames:
            for extension, data in frame.members.items():
                header = tarfile.TarInfo(f"{frame.folder}{frame.index:09d}.{extension}")
                header.size = len(data)
                target.addfile(header, io.BytesIO(data))
