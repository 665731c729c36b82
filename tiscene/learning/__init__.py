# SPDX-License-Identifier: Apache-2.0
"""Continual learning on streams: supervision of pixels, courses of phases, drift, and evaluation.

::

    pixel_labels       labels of single pixels, with one ray each
    teaching_policies  which pixels a teacher labels unasked
    label_ledger       labels that were given
    supervision        Supervision: a teacher with a budget
"""
