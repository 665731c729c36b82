# SPDX-License-Identifier: Apache-2.0
"""Continual learning on streams: supervision of pixels, courses of phases, drift, and evaluation.

::

    pixel_labels       labels of single pixels, with one ray each
    teaching_policies  which pixels a teacher labels unasked
    label_ledger       labels that were given
    supervision        Supervision: a teacher with a budget
    laps               laps of closed paths
    drift              factors that change with the frame number: Step, Ramp, Mix, Cycle
    phase              Phase: a part of a course, and its frames
    course             Course: phases one after another
    course_file        courses as JSON
    stream_pool        streams of several scenarios that share stages
"""
