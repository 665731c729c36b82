# SPDX-License-Identifier: Apache-2.0
"""Column numbers of the per-body arrays of a stepped simulation.

Every body has a row in `bodies`, float64 [n, FLOAT_COLUMNS], and in `integers`, int32 [n, INTEGER_COLUMNS]. Bodies are
of two kinds: those that follow a path (FOLLOWS) and those that fly straight and bounce (BOUNCES). Some columns have a
meaning for one kind only. Vectors take three columns, quaternions (w, x, y, z) four.
"""

from __future__ import annotations

# Float64 columns. Pose and motion: m, unit quaternion, m/s, rad/s.
POSITION, ROTATION, VELOCITY, SPIN = 0, 3, 7, 10
# The attempted motion: translation, m, and rotation vector, rad.
MOVE, TURN = 13, 16
STEP_TIME = 19  # BOUNCES: duration of the attempted motion, s
PATH_LENGTH = 19  # FOLLOWS: distance moved so far in this substep, m
TIME_LEFT = 20  # BOUNCES: s left of this substep; FOLLOWS: 1 while it has further motions to attempt, else 0
TARGET = 21  # pose on the path at the end of the substep
MOVE_BUDGET, TURN_BUDGET = 28, 29  # FOLLOWS: m and rad that it may still move in this substep
MAX_DISPLACEMENT = 30  # m: no point of the body moves farther in this substep
FREE_TIME = 31  # BOUNCES: s for which its current motion is known to meet no obstacle
LOST_TIME = 32  # BOUNCES: s of this frame during which it could not move
WALL_PUSH = 33  # BOUNCES: displacement back inside the walls in this substep, m
MAX_WALL_PUSH = 33  # FOLLOWS: largest such displacement, m
SPEED, ANGULAR_SPEED, RADIUS = 36, 37, 38  # m/s, rad/s, m
ACTIVE_TIME = 39  # s of this substep during which the body's clock runs
CENTER = 40  # mean center of the proxy spheres in the body's own axes, m
FLOAT_COLUMNS = 43

# Integer columns.
KIND, COLLIDES, LIMITED = 0, 1, 2  # FOLLOWS or BOUNCES; whether it collides now; whether walls hold it now
HIT_COUNT, BLOCKED = 3, 4  # bounces so far; was held up in this frame
ATTEMPTS = 5  # BOUNCES: bounces in this substep; FOLLOWS: motions in this substep that were blocked
REACHES_TARGET = 6  # FOLLOWS: whether the attempted motion is the whole way to the target
SEED, NAME_HASH = 7, 8  # of the random numbers
FIRST_GROUP, GROUP_COUNT = 9, 10  # rows of the sphere groups
WALL_PUSHED = 11  # BOUNCES: whether WALL_PUSH is applied
CONTACT_COUNT, FIRST_CONTACT = 12, 13  # contacts of this frame, two columns each: kind and row
MAX_CONTACTS = 6  # recorded per body and frame
INTEGER_COLUMNS = FIRST_CONTACT + 2 * MAX_CONTACTS

FOLLOWS, BOUNCES = 0, 1
