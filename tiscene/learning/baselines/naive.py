# SPDX-License-Identifier: Apache-2.0
"""Naive: fine-tuning on each label as it arrives, without any measure against forgetting."""

from __future__ import annotations

from tiscene.learning.baselines.pixel_network import PixelLearner


class Naive(PixelLearner):
    """Fine-tuning: one step on the labels of each frame."""
