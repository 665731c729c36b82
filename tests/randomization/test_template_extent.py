# SPDX-License-Identifier: Apache-2.0
"""Size of templates: enclosing ball and mean silhouette."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tiscene.randomization.template_extent import mean_silhouette, template_extent


def test_mean_silhouette_of_convex_solids_is_quarter_of_surface():
    """Cauchy's surface area formula."""
    corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
    for sides in ((1, 1, 1), (2, 1, 0.5), (0.01, 0.01, 1), (1, 1, 0)):
        a, b, c = sides
        surface = 2.0 * (a * b + b * c + c * a)
        assert mean_silhouette(corners * sides + 3.0) == pytest.approx(surface / 4.0, rel=0.05)
    assert mean_silhouette(np.zeros((4, 3))) == 0.0


def test_extent_of_sphere_is_its_diameter():
    extent = template_extent("Sphere", "Y")
    assert extent.radius == pytest.approx(0.2, rel=0.01)
    assert extent.diameter == pytest.approx(0.4, rel=0.01)
    turned = template_extent("Sphere", "Z")
    assert (turned.radius, turned.diameter) == pytest.approx((extent.radius, extent.diameter), rel=1e-3)


def test_thin_template_is_smaller_than_its_ball():
    extent = template_extent("Pen 01", "Y")
    assert extent.diameter < extent.radius


def test_extent_is_that_of_the_variant_and_of_the_file_as_it_is(tmp_path):
    part, file = tmp_path / "part.usda", tmp_path / "ball.usda"
    variants = "".join(
        f'    "{name}" {{\n    over "Ball"\n    {{\n    double radius = {radius}\n    }}\n    }}\n'
        for name, radius in (("small", 1), ("large", 3))
    )
    part.write_text(
        '#usda 1.0\n(\n    defaultPrim = "Part"\n)\ndef Xform "Part" (\n    variants = { string size = "small" }\n'
        '    prepend variantSets = "size"\n)\n{\n    def Sphere "Ball" {}\n'
        f'    variantSet "size" = {{\n{variants}    }}\n}}\n'
    )
    file.write_text(
        '#usda 1.0\n(\n    defaultPrim = "Ball"\n    metersPerUnit = 1\n)\n'
        'def Xform "Ball" (\n    references = @./part.usda@\n) {}\n'
    )
    radii = [template_extent(f"{file}{variant}", "Y").radius for variant in ("", "{size=small}", "{size=large}")]
    assert radii == pytest.approx([1.0, 1.0, 3.0], rel=0.01)
    part.write_text(part.read_text().replace("radius = 3", "radius = 5"))
    assert template_extent(f"{file}{{size=large}}", "Y").radius == pytest.approx(5.0, rel=0.01)
