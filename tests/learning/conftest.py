# SPDX-License-Identifier: Apache-2.0
"""The course that learners are evaluated on."""

import pytest

from tests.learning.small_course import make_course
from tiscene.learning.course import Course


@pytest.fixture(scope="module")
def course() -> Course:
    return make_course()
