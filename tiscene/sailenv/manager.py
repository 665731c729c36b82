# SPDX-License-Identifier: Apache-2.0
"""SAILenv's manager started its Unity program. Here there is none to start."""

from __future__ import annotations

from collections.abc import Sequence


class SAILenvException(Exception):
    """What the Unity program said when it ended too early."""

    def __init__(self, stdout: Sequence[str], stderr: Sequence[str], *args: object) -> None:
        super().__init__(*args)
        self.stdout, self.stderr = stdout, stderr


class SAILenvManager:
    """The arguments are taken and of no effect: agents are in process."""

    def __init__(self, port: str = "8085", prefix: str | None = None, sailenv_home: str = "./") -> None:
        self.port, self.prefix, self.sailenv_home = port, prefix, sailenv_home

    def start(self) -> bool:
        """True: agents can be registered."""
        return True

    def stop(self) -> None:
        """Nothing runs."""

    def restart(self) -> None:
        """Stop and start."""
        self.stop()
        self.start()
