# SPDX-License-Identifier: Apache-2.0
"""SAILenv's downloader of its Unity program. Here there is nothing to download: both functions say so and return."""

from __future__ import annotations

import platform

os_names = {"Darwin": "OSX", "Linux": "Linux", "Windows": "Windows"}
os_name = os_names.get(platform.system(), platform.system())


def download_executable(version: str = "latest") -> None:
    """Print that tiscene needs no program; `version` has no effect."""
    print(f"tiscene replaces SAILenv's Unity program (version {version}): there is nothing to download")


def download_source(version: str = "latest") -> None:
    """Print that tiscene needs no Unity project; `version` has no effect."""
    print(f"tiscene replaces SAILenv's Unity project (version {version}): there is nothing to download")
