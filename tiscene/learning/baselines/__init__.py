# SPDX-License-Identifier: Apache-2.0
"""Baselines: learners of pixel categories to compare with. All but `blind` need the extra `torch`.

::

    pixel_network   the network that they share, and its training on labeled pixels
    naive           fine-tuning
    consolidation   points at which a learner protects what it has learned
    replay          experience replay with a reservoir
    ewc             elastic weight consolidation
    si              synaptic intelligence
    lwf             learning without forgetting
    shuffled        the same frames in random order: an upper bound
    nearest_mean    nearest class mean on fixed features
    flow_coherence  features that are coherent along optical flow
    blind           past labels alone, without pictures
"""
