# SPDX-License-Identifier: Apache-2.0
"""FixedSettings: settings of a stream that cannot be changed once it is made."""

from typing import Any

from tiscene.errors import ArgumentError

FIXED = ("seed", "fps", "render_settings", "shutter", "time_code", "taxonomy")


class FixedSettings:
    """Refuses to change FIXED attributes: the world and the renderer are made with them, and would not follow."""

    def __setattr__(self, name: str, value: Any) -> None:
        if name in FIXED and name in vars(self):
            raise ArgumentError(f"{name}={value!r}: a stream cannot change its {name}; make a new Stream with it")
        super().__setattr__(name, value)
