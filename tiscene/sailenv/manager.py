# SPDX-License-Identifier: Apache-2.0
"""SAILenv's manager, which starts and stops its Unity program. Here it does nothing: agents are in process."""

from __future__ import annotations

from collections.abc import Sequence


class SAILenvException(Exception):
    """Raised by SAILenv when its Unity program ends too early; never raised here.

    Attributes:
        stdout: Lines of its standard output.
        stderr: Lines of its standard error.
    """

    def __init__(self, stdout: Sequence[str], stderr: Sequence[str], *args: object) -> None:
        super().__init__(*args)
        self.stdout, self.stderr = stdout, stderr


class SAILenvManager:
    """A manager without a program to manage; its arguments have no effect."""

    def __init__(self, port: str = "8085", prefix: str | None = None, sailenv_home: str = "./") -> None:
        self.port, self.prefix, self.sailenv_home = port, prefix, sailenv_home

    def start(self) -> bool:
        """Return True: agents can be registered."""
        return True

    def stop(self) -> None:
        """Do nothing."""

    def restart(self) -> None:
        """Do nothing."""
