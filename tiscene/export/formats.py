# SPDX-License-Identifier: Apache-2.0
"""FORMATS: the registry of export formats, from which the command line and the table of the documentation derive.

A format is a module. It is imported when the format is first used, so that no library of an extra is loaded before.
The module has, as far as they apply:

==============================  ====================================================================================
`check(buffers)`                raises ExportError, before anything is rendered, if it cannot write these buffers
`check_frames(frames)`          the same for the frames of an export, or of a shard of it
`of_previous(index)`            names of files of a frame that belong to the frame before it: the first frame has none
`encode(frame)`                 the files of a frame by name: `{"rgb/000012.png": bytes}`, or functions (see below)
`pieces(frame, labels, stream)` what a frame adds to files of many frames, by any name; kept on disk until `pack`
`HOLDS_LABELS`                  True: the pieces have `labels`, the frame's metadata, and no file of its own has it
`FRAMES_PER_FILE`               file g has the frames g * FRAMES_PER_FILE and on; None: all frames are in one file
`pack(frames, run, folder)`     writes files of many frames into a folder, from their pieces (see `packing`); may
                                return their content digests by name
`PACKED`                        glob patterns of these files
`READS_ONCE`                    True: `pack` reads the frames once and in order, and uses only the provenance of the
                                run; it may begin before all of them are there
`content_digest(path)`          digest of a file whose bytes are not a function of its contents; None: of its bytes
`SUMMARY`, `summary(run)`       names and contents of files about all frames, which are written again at each export
==============================  ====================================================================================

In place of bytes, `encode` and `pieces` may return a function without arguments that makes them. It is called in
another thread while the next frame is rendered. It must not use what is rendered on demand, such as boxes of objects.

All are functions of the frames alone: no time stamps, no random names. So an export that was killed or split into
shards ends with the same bytes.
"""

from __future__ import annotations

import importlib
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from types import ModuleType

from tiscene.errors import ArgumentError, ExportError, requires_extra


@dataclass(frozen=True)
class Format:
    """An export format.

    Attributes:
        name: Its name, as in `--format NAME`.
        module: The module that writes it.
        summary: What it writes, in a few words.
        readers: Programs and libraries that read it.
        buffers: Buffers that it requires.
        optional: Further buffers that it writes; None: any that the module's `check` permits.
        extra: The extra of pyproject.toml that installs its libraries; "" for none.
        libraries: The top-level modules of these libraries.
    """

    name: str
    module: str
    summary: str
    readers: str
    buffers: tuple[str, ...] = ()
    optional: tuple[str, ...] | None = None
    extra: str = ""
    libraries: tuple[str, ...] = ()

    @property
    def default_buffers(self) -> tuple[str, ...] | None:
        """Buffers to render without a choice: those that it requires, and rgb; None: those of Stream."""
        return tuple(dict.fromkeys(("rgb", *self.buffers))) if self.buffers else None

    def writer(self) -> ModuleType:
        """Return the module.

        Raises:
            MissingExtra: A library of the format is not installed.
        """
        with requires_extra(self.extra):
            for library in self.libraries:
                importlib.import_module(library)
        return importlib.import_module(self.module)

    def check(self, buffers: Collection[str], frames: Collection[int] | None = None) -> None:
        """Raise an error if the format cannot write an export. Its libraries need not be installed.

        Args:
            buffers: Of the stream.
            frames: Indices of the frames; None: not known yet.

        Raises:
            ArgumentError: The format requires another buffer.
            ExportError: The format does not write one of the buffers, or not these frames.
        """
        written = buffers if self.optional is None else (*self.buffers, *self.optional)
        missing = [name for name in self.buffers if name not in buffers]
        surplus = [name for name in buffers if name not in written]
        if missing or surplus:
            faults = [f"requires the buffer {', '.join(map(repr, missing))}"] if missing else []
            faults += [f"does not write {', '.join(map(repr, surplus))}"] if surplus else []
            fitting = (*(name for name in buffers if name in written), *missing)
            raise (ArgumentError if missing else ExportError)(
                f"format={self.name!r} {' and '.join(faults)}: make the stream with buffers={fitting!r} "
                f"(--buffers {','.join(fitting)}){', or export as npz, exr or webdataset' if surplus else ''}"
            )
        module = importlib.import_module(self.module)
        if hasattr(module, "check"):
            module.check(buffers)
        if frames is not None and hasattr(module, "check_frames"):
            module.check_frames(frames)


FORMATS: dict[str, Format] = {
    each.name: each
    for each in (
        Format("png", "tiscene.export.png", "one folder a buffer, one PNG, .flo or .npy a frame", "everything"),
        Format("exr", "tiscene.export.exr", "one multi-part EXR a frame, one part a buffer", "Nuke, Blender, OpenEXR"),
        Format(
            "exr-single",
            "tiscene.export.exr_single",
            "one folder a buffer, one single-part EXR a frame",
            "OpenCV, imageio, tev",
        ),
        Format("npz", "tiscene.export.npz", "one NumPy archive a frame, every buffer exactly", "NumPy"),
        Format(
            "cryptomatte",
            "tiscene.export.cryptomatte",
            "mattes for compositing, one EXR a frame",
            "Nuke, Fusion, Blender",
            ("coverage", "material_coverage"),
            ("rgb", "hdr"),
        ),
        Format(
            "sailenv",
            "tiscene.export.sailenv_layout",
            "the layout of SAILenv's recordings",
            "SAILenv's programs",
            ("rgb", "semantic", "backward_flow"),
            (),
        ),
        Format(
            "kitti-flow",
            "tiscene.export.kitti_flow",
            "flow as 16-bit PNG with a valid channel, as in KITTI",
            "OpenCV, torchvision, RAFT",
            ("rgb", "forward_flow", "forward_occlusion"),
            (),
        ),
        Format(
            "coco",
            "tiscene.export.coco",
            "boxes, masks (RLE) and tracks in COCO's JSON, beside PNG pictures",
            "pycocotools, supervision, FiftyOne",
            ("rgb", "instance"),
            (),
        ),
        Format(
            "webdataset",
            "tiscene.export.webdataset_shards",
            "tar shards of 1000 frames",
            "webdataset, Hugging Face datasets",
        ),
        Format(
            "parquet",
            "tiscene.export.parquet",
            "a Hugging Face data set: Parquet files of 250 frames, and a card",
            "datasets, DuckDB, Polars",
            extra="parquet",
            libraries=("pyarrow",),
        ),
        Format(
            "blenderproc",
            "tiscene.export.blenderproc",
            "one HDF5 file a frame, with BlenderProc's keys",
            "h5py, BlenderProc's tools",
            extra="hdf5",
            libraries=("h5py",),
        ),
        Format(
            "video",
            "tiscene.export.video",
            "one video a buffer: H.264 to look at, FFV1 exactly for ids and masks",
            "FFmpeg, PyAV, torchcodec",
            extra="video",
            libraries=("av",),
        ),
        Format(
            "tracks",
            "tiscene.export.point_tracks",
            "exact point tracks with visibility, as in TAP-Vid",
            "NumPy, TAP-Vid's evaluation",
            ("instance",),
            ("rgb",),
        ),
        Format(
            "mcap",
            "tiscene.export.mcap_log",
            "an MCAP log with Foxglove's messages",
            "Foxglove, mcap, Rerun",
            extra="mcap",
            libraries=("mcap",),
        ),
        Format(
            "lerobot",
            "tiscene.export.lerobot",
            "a LeRobot data set (v3.0): Parquet and video",
            "lerobot",
            ("rgb",),
            (),
            extra="lerobot",
            libraries=("pyarrow", "av"),
        ),
        Format(
            "rerun",
            "tiscene.export.rerun_recording",
            "Rerun recordings (.rrd) with pictures, boxes and cameras",
            "Rerun",
            extra="rerun",
            libraries=("rerun",),
        ),
    )
}


def register_format(format: Format) -> None:
    """Add a format, so that `export` and the command line know it by its name.

    Raises:
        ArgumentError: The name is taken.
    """
    if format.name in FORMATS:
        raise ArgumentError(f"format {format.name!r}: the name is taken; choose another")
    FORMATS[format.name] = format


def find_format(name: str) -> Format:
    """Return a format by name. Raises ArgumentError for an unknown one."""
    if name not in FORMATS:
        raise ArgumentError(f"format={name!r}: must be one of {', '.join(FORMATS)}")
    return FORMATS[name]


def format_table(formats: Iterable[Format] = FORMATS.values()) -> str:
    """Return the formats as a Markdown table."""
    lines = ["| `--format` | Writes | Read by | Requires buffers | Install |", "|---|---|---|---|---|"]
    for each in formats:
        buffers = ", ".join(f"`{name}`" for name in each.buffers) or "–"
        install = f"`tiscene[{each.extra}]`" if each.extra else "–"
        lines.append(f"| `{each.name}` | {each.summary} | {each.readers} | {buffers} | {install} |")
    return "\n".join(lines) + "\n"
