# SPDX-License-Identifier: Apache-2.0
"""What the kernels of a stepped simulation keep of every body: the names of the columns."""

from __future__ import annotations

# Float64 columns of a body. The first STATE are all that the next frame depends on, with the integers below.
POSITION, ROTATION, VELOCITY, SPIN, STATE = 0, 3, 7, 10, 13
# The motion that is tried: translation, m, and rotation vector, rad; the time it takes, s. Of what follows a path, STEP
# is how far it has moved in this substep, m.
MOVE, TURN, STEP = 13, 16, 19
TIME_LEFT = 20  # time left of this substep; of a follower: 1 until it has done what it can
TARGET = 21  # pose on the path at the end of the substep
MOVE_BUDGET, TURN_BUDGET = 28, 29  # m, rad that a follower may still move in this substep
MAX_DISPLACEMENT = 30  # m: no point of the body moves farther in this substep
FREE_TIME = 31  # s for which what flies is known to meet no obstacle if it goes on as it does
LOST_TIME = 32  # s of this frame in which it could not move
WALL_PUSH = 33  # displacement back into the walls for this substep, m; of a follower its length at most
SPEED, ANGULAR_SPEED, RADIUS = 36, 37, 38  # m/s, rad/s, m
ACTIVE_TIME = 39  # s of this substep in which its clock runs
CENTER = 40  # of the proxy spheres, in the body's own axes, m
FLOAT_COLUMNS = 43

# Integer columns of a body.
KIND, COLLIDES, LIMITED, ON_PATH, HIT_COUNT, BLOCKED, ATTEMPTS, REACHES_TARGET = 0, 1, 2, 3, 4, 5, 6, 7
SEED, NAME_HASH, FIRST_GROUP, GROUP_COUNT, WALL_PUSHED, CONTACT_COUNT, FIRST_CONTACT = 8, 9, 10, 11, 12, 13, 14
MAX_CONTACTS = 6  # that a body remembers of a frame; each takes two columns: kind and row
INTEGER_COLUMNS = FIRST_CONTACT + 2 * MAX_CONTACTS

FOLLOWS, BOUNCES = 0, 1
