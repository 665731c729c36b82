# SPDX-License-Identifier: Apache-2.0
"""A stream in a notebook."""

from tiscene.scenario.objects import Object
from tiscene.scenario.scenario import Scenario
from tiscene.stream.stream import Stream


def test_notebook_shows_settings_without_rendering(monkeypatch):
    scenario = Scenario("solid_benchmark", [Object("<ball>", "Ball 01", (0, 1, -3))])
    stream = Stream(scenario, width=16, height=12, frames=50, fps=10, seed=7, buffers=("depth", "instance"))
    monkeypatch.setattr(Stream, "_render", None)
    html = stream._repr_html_()
    for shown in (
        "solid_benchmark",
        "&lt;ball&gt; (Ball 01)",
        "16 × 12 px",
        "50 frames, 5 s",
        "depth, instance",
        "seed 7",
    ):
        assert shown in html
    assert "<ball>" not in html
    assert "endless" in Stream("solid_benchmark", width=16, height=12, buffers=("depth",))._repr_html_()
