# SPDX-License-Identifier: Apache-2.0
"""SAILenv's manager and downloader of its Unity program. Here they do nothing: agents are in process.

`executables_per_platform` has SAILenv's names of its program, for scripts that look for it; nothing here runs it.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence

os_names = {"Darwin": "OSX", "Linux": "Linux", "Windows": "Windows"}
os_name = os_names.get(platform.system(), platform.system())
executables_per_platform = {
    "Windows": "SAILenv.exe",
    "Linux": "SAILenv.run",
    "Darwin": os.path.join("SAILenv.app", "Contents", "MacOS", "SAILenv"),
}


class SAILenvException(Exception):
    """Raised by SAILenv when its Unity program ends too early; never raised here.

    Attributes:
        stdout: Lines of its standard output.
        stderr: Lines of its standard error.
    """

    def __init__(self, stdout: Sequence[str], stderr: Sequence[str], *args: object) -> None:
        super().__init__(*args)
        self.stdout, self.stderr = stdout, stderr

    def __str__(self) -> str:
        return "\n".join(["STDOUT:", *self.stdout, "STDERR:", *self.stderr])


class SAILenvManager:
    """A manager without a program to manage; its arguments have no effect.

    Attributes:
        sailenv_exe: Where SAILenv's program would be.
        process: None, since no process is started.
    """

    def __init__(self, port: str = "8085", prefix: str | None = None, sailenv_home: str = "./") -> None:
        self.port, self.prefix, self.sailenv_home = port, prefix, sailenv_home
        executable = executables_per_platform.get(platform.system(), executables_per_platform["Linux"])
        self.sailenv_exe = os.path.join(sailenv_home, executable)
        self.process: None = None

    def start(self) -> bool:
        """Return True: agents can be registered."""
        return True

    def stop(self) -> None:
        """Do nothing."""

    def restart(self) -> None:
        """Do nothing."""


def download_executable(version: str = "latest") -> None:
    """Print that tiscene needs no program; `version` has no effect."""
    print(f"tiscene replaces SAILenv's Unity program (version {version}): there is nothing to download")


def download_source(version: str = "latest") -> None:
    """Print that tiscene needs no Unity project; `version` has no effect."""
    print(f"tiscene replaces SAILenv's Unity project (version {version}): there is nothing to download")
