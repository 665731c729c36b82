# SPDX-License-Identifier: Apache-2.0
"""Courses in the form that other libraries take; each module needs the extra of its library.

::

    labeled_patches  labeled pixels with their surroundings, in the order of the course
    course_frames    PyTorch, Grain and Hugging Face: the loaders of a stream (extras torch, grain, huggingface)
    avalanche_benchmark  Avalanche: an experience for each phase (extra avalanche)
    river_pairs      river: pairs of features and category (extra river)
    look_around      Gymnasium: LookAround-v0 (extra gymnasium)
    unaiverse_streams  UNaIVERSE: pictures and targets of an agent (extra unaiverse)
"""
