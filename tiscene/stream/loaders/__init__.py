# SPDX-License-Identifier: Apache-2.0
"""Streams as data sets of machine learning libraries. Each library is imported when it is used.

::

    frame_samples    frames as dicts of NumPy arrays
    indexed_dataset  map-style data set, for PyTorch and Grain
    torch_stream     PyTorch IterableDataset and collation
    hugging_face     Hugging Face IterableDataset
    loader_methods   the methods of Stream that make them
"""
