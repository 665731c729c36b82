# SPDX-License-Identifier: Apache-2.0
"""Evaluations that are interrupted continue from their checkpoints; those of others are refused."""

import pickle
import subprocess
import sys
from pathlib import Path

import pytest

from tests.learning.small_course import Constant, NearestAlbedo, make_course
from tiscene.errors import ArgumentError
from tiscene.learning.clock import Clock
from tiscene.learning.evaluation import MAGIC, evaluate
from tiscene.learning.score import differences
from tiscene.learning.stream_metrics import NearFutureAccuracy, OnlineAccuracy

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_score_is_recomputed_by_another_process_from_a_checkpoint(tmp_path):
    """Half of the course here, the rest in another process: the same score as without interruption."""
    whole = evaluate(NearestAlbedo(), make_course())
    make_course().save(tmp_path / "course.json")
    program = """
import sys
sys.path.insert(0, {root!r})
from tests.learning.small_course import NearestAlbedo
from tiscene.learning.course import Course
from tiscene.learning.evaluation import evaluate
class Stopping(NearestAlbedo):
    def learn(self, frame, answers):
        super().learn(frame, answers)
        if frame.index == 17:
            raise KeyboardInterrupt
try:
    evaluate(Stopping(), Course.load({course!r}), checkpoint={file!r})
except KeyboardInterrupt:
    print("stopped")
"""
    names = {"root": str(ROOT), "course": str(tmp_path / "course.json"), "file": str(tmp_path / "state")}
    done = subprocess.run([sys.executable, "-c", program.format(**names)], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "stopped"
    learned = []

    class Continuing(NearestAlbedo):
        def learn(self, frame, answers):
            learned.append(frame.index)
            super().learn(frame, answers)

    resumed = evaluate(Continuing(), make_course(), checkpoint=tmp_path / "state")
    assert learned == list(range(12, 24))  # from the end of the first phase on
    assert not (tmp_path / "state").exists()
    first, second = whole.to_json(), resumed.to_json()
    first["learner"] = second["learner"] = {}
    assert differences(first, second) == []
    assert first["labels"] == second["labels"]


def test_evaluation_interrupted_in_its_first_frames_continues_without_testing_again(course, tmp_path):
    def run(stop_at, **others):
        def progress(text, done, total):
            seen.append(text)
            if text.startswith("phase") and done == stop_at:
                raise KeyboardInterrupt

        seen, file = [], tmp_path / "state"
        try:
            evaluate(NearestAlbedo(), course, checkpoint=file, progress=progress, **others)
        except KeyboardInterrupt:
            assert file.exists()
        return seen

    assert run(2).count("tests after untrained") == 6 + 2
    assert run(4, checkpoint_every=0) == ["phase ball"] * 5
    assert run(None).count("phase ball") == 8
    assert not (tmp_path / "state").exists()


def test_checkpoints_of_others_are_refused(course, tmp_path):
    def untouched(*_):
        raise AssertionError("is refused before anything is predicted")

    with pytest.raises(ArgumentError, match="needs a learner with state_dict"):
        evaluate(Constant(), course, [OnlineAccuracy()], checkpoint=tmp_path / "a", progress=untouched)
    (tmp_path / "b").write_bytes(MAGIC + b"nothing")
    with pytest.raises(ArgumentError, match="cannot be read"):
        evaluate(NearestAlbedo(), course, checkpoint=tmp_path / "b")
    (tmp_path / "c").write_bytes(MAGIC + pickle.dumps({"version": 1, "course": "other", "runs": {}}))
    with pytest.raises(ArgumentError, match="of another course"):
        evaluate(NearestAlbedo(), course, checkpoint=tmp_path / "c")


class Executed:
    """Raises when it is unpickled."""

    def __reduce__(self):
        return pytest.fail, ("was unpickled",)


@pytest.mark.parametrize("content", [b"my notes", pickle.dumps(Executed())], ids=["text", "pickle"])
def test_file_that_is_no_checkpoint_is_neither_unpickled_nor_overwritten(course, tmp_path, content):
    path = tmp_path / "file"
    path.write_bytes(content)
    with pytest.raises(ArgumentError, match=r"file': is not a checkpoint of an evaluation; name another file"):
        evaluate(NearestAlbedo(), course, checkpoint=path)
    assert path.read_bytes() == content
    with pytest.raises(ArgumentError, match="is a folder; name a file"):
        evaluate(NearestAlbedo(), course, checkpoint=tmp_path)


def test_checkpoints_of_other_metrics_or_another_clock_are_refused(course, tmp_path):
    def stop(text, done, total):
        if done == 6:
            raise KeyboardInterrupt

    metrics, file = [OnlineAccuracy(), NearFutureAccuracy(2)], {"checkpoint": tmp_path / "state"}
    with pytest.raises(KeyboardInterrupt):
        evaluate(NearestAlbedo(), course, metrics, **file, progress=stop)
    for others, clock in ((metrics[:1], 0), (metrics[::-1], 0), ([metrics[0], NearFutureAccuracy(3)], 0), (metrics, 2)):
        with pytest.raises(ArgumentError, match="of other metrics or of another clock; delete it"):
            evaluate(NearestAlbedo(), course, others, clock=Clock(clock), **file)
    evaluate(NearestAlbedo(), course, metrics, **file)
