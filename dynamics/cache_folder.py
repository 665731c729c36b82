# SPDX-License-Identifier: Apache-2.0
"""The folder of Taichi's cache where the environment names none: Taichi 1.7.4 aborts the process at its import then."""

from __future__ import annotations

import os


def set_cache_folder() -> None:
    """Set XDG_CACHE_HOME where HOME is not set either: to `.cache` in the user's home, else to a private folder."""
    if os.name != "posix" or "HOME" in os.environ or "XDG_CACHE_HOME" in os.environ:
        return
    import pwd

    try:
        folder = os.path.join(pwd.getpwuid(os.getuid()).pw_dir, ".cache")
    except KeyError:  # a user without an entry, as in containers
        import tempfile

        folder = os.path.join(tempfile.gettempdir(), f"tiscene-{os.getuid()}")
        os.makedirs(folder, mode=0o700, exist_ok=True)
        found = os.lstat(folder)
        if found.st_uid != os.getuid() or found.st_mode & 0o077:  # somebody else could place compiled code there
            folder = tempfile.mkdtemp(prefix="tiscene-")
    os.environ["XDG_CACHE_HOME"] = folder
