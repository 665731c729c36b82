# SPDX-License-Identifier: Apache-2.0
"""`tiscene serve` in a process of its own."""

import contextlib
import re
import signal
import subprocess
import sys


class Served:
    """A running server.

    Attributes:
        process: The process.
        address: Host and port.
    """

    def __init__(self, folder, *arguments):
        self._log = folder / "serve.log"
        command = [sys.executable, "-m", "tiscene", "serve", "--port", "0", "-v", *arguments]
        with self._log.open("w") as log:
            self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True)
        line = self.process.stdout.readline()
        found = re.fullmatch(r"listening on (.*):(\d+)\n", line)
        assert found, f"{line!r}; {self.log}"
        self.address = found[1], int(found[2])

    @property
    def log(self):
        """The text of its log so far."""
        return self._log.read_text()

    def stop(self, number=signal.SIGTERM):
        """Send a signal; return the exit status."""
        self.process.send_signal(number)
        try:
            return self.process.wait(30.0)
        finally:
            self.process.kill()
            self.process.stdout.close()


@contextlib.contextmanager
def served(folder, *arguments):
    """Yield a server, and check that it stops without an error."""
    server = Served(folder, *arguments)
    try:
        yield server
    finally:
        assert server.stop() == 0
        assert "Traceback" not in server.log
