# SPDX-License-Identifier: Apache-2.0
"""Messages about what of a stage is left out: prims of one cause share a line."""

from __future__ import annotations

import pytest

from tests.usd.helpers import problems_of, read_with_warning
from tiscene.errors import StageError, StageWarning
from tiscene.usd.core.report import StageReport

CUBE = 'def Cube "Good" {}\n'


def test_prims_with_the_same_problem_share_a_line():
    report = StageReport("stage")
    for number in range(9):
        report.problem(f"/M{number}", "mesh", "it has no points")
        report.problem("/M0", "mesh", "it has no points")
    report.problem("/M1", "light", "it has no points")
    with pytest.raises(StageError) as caught:
        report.raise_problems()
    assert caught.value.problems == (
        "</M0> mesh: it has no points; also </M1>, </M2>, </M3>, </M4> and 4 more",
        "</M1> light: it has no points",
    )
    with pytest.warns(StageWarning, match=r"and 4 more; left out\n  </M1> light: it has no points; left out$"):
        report.warn()


@pytest.mark.parametrize("content", [None, "#usda 1.0\ngarbage\n"], ids=["missing", "damaged"])
def test_references_to_one_bad_file_share_a_line(tmp_path, content):
    if content:
        (tmp_path / "bad.usda").write_text(content)
    body = CUBE + "".join(f'def "R{number}" (references = @./bad.usda@) {{}}\n' for number in range(7))
    (problem,) = problems_of(tmp_path, body)
    assert problem.startswith("</R0> composition: Could not open asset")
    assert problem.endswith("; also </R1>, </R2>, </R3>, </R4> and 2 more")


def test_what_a_line_points_to_is_named(tmp_path):
    body = CUBE.replace("{", "{\nrel material:binding = </Looks/Gone>\n")
    read_with_warning(tmp_path, body, "a material that does not exist is not applied: </Good> to </Looks/Gone>$")
