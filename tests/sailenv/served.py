# SPDX-License-Identifier: Apache-2.0
"""`tiscene serve` in a process of its own, as it is used."""

import contextlib
import os
import re
import signal
import subprocess
import sys


class Served:
    """A running server. address: where; log: what it has said so far."""

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
        return self._log.read_text()

    @property
    def resident(self):
        """Bytes of memory."""
        with open(f"/proc/{self.process.pid}/statm") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    def stop(self, how=signal.SIGTERM):
        """End it as a person or a system would; the exit status."""
        self.process.send_signal(how)
        try:
            return self.process.wait(30.0)
        finally:
            self.process.kill()
            self.process.stdout.close()


@contextlib.contextmanager
def served(folder, *arguments):
    """A server that ends well."""
    server = Served(folder, *arguments)
    try:
        yield server
    finally:
        assert server.stop() == 0
        assert "Traceback" not in server.log
