# SPDX-License-Identifier: Apache-2.0
"""Stages of several rooms: `tiscene.usd.join`.

::

    room_join       join: write a stage that references rooms
    room_conflicts  what holds for a whole stage and differs between rooms
    floor_plan      RoomPlacement, Opening
    stage_cut       cut openings into the gprims of a stage
    lining          jambs, heads and thresholds of the openings
    box_cut         cut polygons by a box
"""
