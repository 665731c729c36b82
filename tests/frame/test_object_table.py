# SPDX-License-Identifier: Apache-2.0
"""Columns of the object table."""

import numpy as np

from tests.export.fake_stream import CHAIR, ChairMeasurements
from tiscene.frame.object_table import ObjectTable


def test_representation_has_the_number_of_objects_and_the_first_names() -> None:
    assert repr(ObjectTable((CHAIR,) * 3)) == f"<3 objects: {CHAIR.name}, {CHAIR.name}, {CHAIR.name}>"
    assert repr(ObjectTable((CHAIR,) * 300)) == f"<300 objects: {', '.join([CHAIR.name] * 10)}, ...>"


def test_columns_are_1d_and_of_equal_length_as_data_frames_need() -> None:
    for table, rows in ((ObjectTable([CHAIR], ChairMeasurements()), 1), (ObjectTable(), 0)):
        columns = table.columns()
        assert {column.shape for column in columns.values()} == {(rows,)}
        assert all(column.flags.c_contiguous for column in columns.values())
        assert len(columns) == 50


def test_columns_of_vectors_are_named_by_component() -> None:
    columns = {name: column[0] for name, column in ObjectTable([CHAIR], ChairMeasurements()).columns().items()}
    assert [columns[f"position_{axis}"] for axis in "xyz"] == [1.0, 0.5, 0.0]
    assert [columns[f"rotation_{axis}"] for axis in "wxyz"] == [1.0, 0.0, 0.0, 0.0]
    assert [columns[f"visible_box_{corner}"] for corner in ("x0", "y0", "x1", "y1")] == [1.0, 2.0, 4.0, 5.0]
    assert np.isnan(columns["amodal_box_x0"])
    corners = [columns[f"world_bounds_{corner}"] for corner in ("x0", "y0", "z0", "x1", "y1", "z1")]
    assert corners == [0.5, 0.0, -0.5, 1.5, 1.0, 0.5]
    assert [columns[f"box_3d_rotation_{axis}"] for axis in "wxyz"] == [1.0, 0.0, 0.0, 0.0]
    assert [columns[f"box_3d_size_{axis}"] for axis in "xyz"] == [1.0, 1.0, 1.0]
    assert (columns["name"], columns["last_frame"]) == ("chair", -1)


def test_arrays_keep_vectors_together() -> None:
    arrays = ObjectTable([CHAIR], ChairMeasurements()).arrays()
    assert {name: array.shape[1] for name, array in arrays.items() if array.ndim == 2} == {
        **dict.fromkeys(("position", "velocity", "box_3d_center", "box_3d_size"), 3),
        **dict.fromkeys(("rotation", "box_3d_rotation", "visible_box", "amodal_box"), 4),
        "world_bounds": 6,
    }
