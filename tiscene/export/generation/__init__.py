# SPDX-License-Identifier: Apache-2.0
"""Data sets of many random scenarios, from a recipe.

::

    recipe               Recipe: scenes, ranges, settings and splits, and the scenario of each number
    generator            generate: render the scenarios into a folder
    scenario_summary     what the index knows of a scenario
    data_set_index       index, statistics and contact sheet of a data set
    coco_splits          COCO's JSON of all scenarios of a split
    lerobot_splits       LeRobot's data set of a split, with an episode for each scenario
    split_parts          reading what the scenarios of a split have
    data_set_verification  verify_data_set: scenarios as recorded, frames that render as recorded, the index
"""
