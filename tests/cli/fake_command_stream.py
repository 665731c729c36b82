# SPDX-License-Identifier: Apache-2.0
"""A stream for commands, without a renderer."""

from types import SimpleNamespace

from tests.export.fake_stream import FakeStream
from tiscene.errors import SceneNotFound


class FakeCommandStream(FakeStream):
    """A FakeStream with the constructor of Stream; `made` lists all instances, `others` their further arguments."""

    made: list["FakeCommandStream"] = []  # noqa: RUF012
    interrupt_at = None
    arch = "cuda"
    world = SimpleNamespace(descriptions=[SimpleNamespace(instances=("cube",))])

    def __init__(self, source, *, width, height, buffers, seed=0, **others) -> None:
        if source == "nowhere":
            raise SceneNotFound("scene", source, ["somewhere"])
        super().__init__(buffers, width=width, height=height, seed=seed)
        self.source, self.others = source, others
        self.interrupt_at = type(self).interrupt_at
        self.made.append(self)

    @property
    def render_settings(self):
        return SimpleNamespace(spp=4)

    def __next__(self):
        return self[len(self.rendered)]
