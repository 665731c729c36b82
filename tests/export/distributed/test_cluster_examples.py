# SPDX-License-Identifier: Apache-2.0
"""The files in examples/cluster: valid, and run where their scheduler is a library."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.export.folders import contents
from tiscene import catalog
from tiscene.cli import main as cli
from tiscene.cli.parser import parser
from tiscene.export.distributed.worker_processes import INCOMPLETE
from tiscene.export.generation.recipe import Recipe

FOLDER = Path(__file__).parents[3] / "examples" / "cluster"


def test_recipe_is_valid_and_names_scenes_and_variants_that_exist():
    recipe = Recipe.load(FOLDER / "recipe.json")
    for choice in recipe.scenes:
        text = catalog.find_scene(choice.scene).read_text()
        for place, names in choice.variants.items():
            prim, _, name = place.strip("/}").partition("{")
            assert f'variantSet "{name}"' in text
            assert f'"{prim}"' in text
            assert all(f'"{variant}"' in text for variant in names)


def test_slurm_script_runs_a_shard_for_each_task_of_an_array(tmp_path):
    fake = tmp_path / "tiscene"
    fake.write_text('#!/usr/bin/env bash\necho "$@" "$TI_CPU_MAX_NUM_THREADS"\n')
    fake.chmod(0o755)
    task = {"SLURM_ARRAY_TASK_ID": "13", "SLURM_ARRAY_TASK_MIN": "10", "SLURM_ARRAY_TASK_COUNT": "5"}
    environment = {**os.environ, **task, "SLURM_CPUS_PER_TASK": "4", "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    command = ["bash", str(FOLDER / "slurm.sh"), "recipe.json", "50", "out"]
    printed = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.split()
    args = parser().parse_args(printed[:-1])
    assert (args.command, args.recipe, args.count, args.output, args.shard) == (
        *("generate", "recipe.json", 50, "out"),
        (3, 5),
    )
    assert printed[-1] == "4"


def test_kubernetes_job_runs_each_index_as_a_shard():
    yaml = pytest.importorskip("yaml")
    job = yaml.safe_load((FOLDER / "kubernetes.yaml").read_text())
    (container,) = job["spec"]["template"]["spec"]["containers"]
    count = job["spec"]["completions"]
    words = [*container["command"][1:], *container["args"]]
    args = parser().parse_args([word.replace("$(JOB_COMPLETION_INDEX)", str(count - 1)) for word in words])
    assert args.shard == (count - 1, count)
    (rule,) = job["spec"]["podFailurePolicy"]["rules"]
    assert (rule["action"], rule["onExitCodes"]["values"]) == ("FailIndex", [INCOMPLETE])
    assert rule["onExitCodes"]["containerName"] == container["name"]
    assert job["spec"]["completionMode"] == "Indexed"
    assert job["spec"]["parallelism"] <= count


def openjd(*arguments, **environment):
    command = [sys.executable, "-m", "openjd", *arguments]
    return subprocess.run(command, capture_output=True, text=True, env=os.environ | environment, check=False)


def test_open_job_description_is_valid():
    pytest.importorskip("openjd.cli")
    checked = openjd("check", str(FOLDER / "openjd.yaml"))
    assert checked.returncode == 0, checked.stdout + checked.stderr


@pytest.mark.slow
def test_open_job_description_renders_the_bytes_of_one_process(tmp_path):
    pytest.importorskip("openjd.cli")
    options = "--width 32 --height 24 --buffers instance,depth --format webdataset"
    render = ["render", "solid_benchmark", "--frames", "0:6", *options.split(), "-o", str(tmp_path / "one")]
    assert cli.main(render) == 0
    tiscene = tmp_path / "bin" / "tiscene"
    tiscene.parent.mkdir()
    tiscene.write_text(f'#!/usr/bin/env bash\nexec {sys.executable} -m tiscene "$@"\n')
    tiscene.chmod(0o755)
    parameters = {"Source": "solid_benchmark", "Output": str(tmp_path / "out"), "Frames": "0:6", "Options": options}
    parameters |= {"Shards": "0-1", "Count": "2"}
    given = [word for name, value in parameters.items() for word in ("-p", f"{name}={value}")]
    path = {"PATH": f"{tiscene.parent}:{os.environ['PATH']}"}
    template = str(FOLDER / "openjd.yaml")
    done = openjd("run", template, "--step", "Merge", "--run-dependencies", *given, **path)
    assert done.returncode == 0, done.stdout + done.stderr
    found = {name: data for name, data in contents(tmp_path / "out").items() if not name.startswith("shards")}
    assert found == contents(tmp_path / "one")
    assert re.search(r"files of 6 frames are complete; 3 rendered again, same bytes", done.stdout)
    assert json.loads((tmp_path / "out" / "tiscene.json").read_text())["format"] == "webdataset"
