# SPDX-License-Identifier: Apache-2.0
"""Tasks: each is done once, consecutive ones by one worker; those of lost workers are done again, but not forever."""

import random

import pytest

from tiscene.errors import DeviceError, StageWarning
from tiscene.export.distributed import task_loop
from tiscene.export.distributed.task_loop import Opened, PoolEvent, run_tasks
from tiscene.export.distributed.task_plan import MAX_ATTEMPTS, MAX_TASK, MAX_TASKS, TaskPlan, task_size

MACHINE = {"numpy": "2", "processor": "abc"}


@pytest.mark.parametrize("count", [1, 63, 64, 100, 5000, 10**7])
def test_tasks_are_small_for_few_frames_and_bounded_in_number(count):
    size = task_size(count)
    assert size >= 1
    assert -(-count // size) <= MAX_TASKS
    assert size <= MAX_TASK or count > MAX_TASK * MAX_TASKS
    assert size == 1 or count // size >= 64


def test_worker_gets_consecutive_tasks_and_newcomers_halve_the_longest_run():
    plan = TaskPlan(range(16))
    assert plan.take("a") == 0
    assert plan.take("b") == 8  # 1 to 15 are left, and a continues with 1
    assert plan.take("c") in (4, 12)
    order = {"a": [], "b": []}
    for _ in range(2):
        for worker in ("a", "b"):
            plan.finish(worker)
            order[worker].append(plan.take(worker))
    assert order == {"a": [1, 2], "b": [9, 10]}


def test_every_task_is_done_once_in_any_order_of_events():
    draws = random.Random(5)
    for _ in range(200):
        count, names = draws.randrange(1, 40), [f"w{number}" for number in range(draws.randrange(1, 6))]
        plan, held, finished = TaskPlan(range(count)), {}, []
        while not plan.finished:
            worker = draws.choice(names)
            if worker not in held:
                task = plan.take(worker)
                if task is not None:
                    assert task not in held.values()
                    held[worker] = task
            elif draws.random() < 0.05:
                try:
                    plan.give_back(worker, "lost")
                except DeviceError:
                    break
                del held[worker]
            else:
                assert plan.finish(worker) == held[worker]
                finished.append(held.pop(worker))
            assert plan.held == sorted(held.values())
        else:
            assert sorted(finished) == sorted(plan.done) == list(range(count))


def test_skipped_tasks_are_not_handed_out():
    plan = TaskPlan(range(6))
    plan.skip([0, 2, 3])
    assert [plan.take(name) for name in "abcd"] == [4, 1, 5, None]
    assert plan.done == [0, 2, 3]


class FakePool:
    """Workers that do a task in one step; `faults` are the kinds of events in place of "done", by task."""

    def __init__(self, names, faults=None, machines=None, depends=None):
        self.done, self.given, self.faults = [], {}, faults or {}
        self.machines, self.depends = machines or {}, depends or {}
        self.events = [self.opened(name) for name in names]
        self.replaced = 0

    def opened(self, name):
        opened = Opened(self.depends.get(name, {"seed": 1}), self.machines.get(name, MACHINE))
        return PoolEvent(name, "opened", opened=opened, warnings=["a prim is left out"])

    def start_workers(self):
        pass

    def submit(self, worker, task):
        assert worker not in self.given
        self.given[worker] = task

    def wait(self, timeout):
        events, self.events = self.events, []
        for worker, task in list(self.given.items()):
            del self.given[worker]
            kinds = self.faults.get(task)
            kind = kinds.pop(0) if kinds else "done"
            if kind == "done":
                self.done.append(task)
            events.append(PoolEvent(worker, kind, reason="signal 9"))
            if kind == "lost":
                self.replaced += 1
                self.events.append(self.opened(f"new {self.replaced}"))
        return events


def test_loop_does_all_tasks_and_repeats_those_of_lost_workers():
    pool, seen = FakePool(["a", "b"], {3: ["lost", "failed", "lost"], 7: ["lost"]}), []
    with pytest.warns(StageWarning) as caught:
        run_tasks(pool, TaskPlan(range(10)), opened=seen.append)
    assert sorted(pool.done) == list(range(10))
    assert seen == [{"seed": 1}]
    assert len(caught) == 1


@pytest.mark.filterwarnings("ignore::tiscene.errors.StageWarning")
def test_task_that_always_fails_ends_the_run_with_its_reason():
    pool = FakePool(["a"], {2: ["lost"] * MAX_ATTEMPTS})
    with pytest.raises(DeviceError, match=f"task 2 failed {MAX_ATTEMPTS} times, the last time on new 3: signal 9"):
        run_tasks(pool, TaskPlan(range(4)))


@pytest.mark.filterwarnings("ignore::tiscene.errors.StageWarning")
def test_unlike_workers_are_refused_unless_permitted():
    machines = {"b": MACHINE | {"numpy": "1"}}
    with pytest.raises(DeviceError, match=r"a and b are unlike machines \(numpy\)"):
        run_tasks(FakePool(["a", "b"], machines=machines), TaskPlan(range(4)))
    run_tasks(FakePool(["a", "b"], machines=machines), TaskPlan(range(4)), unlike=True)
    with pytest.raises(DeviceError, match=r"other versions or files of the scene:\s+seed: 1"):
        run_tasks(FakePool(["a", "b"], depends={"b": {"seed": 2}}), TaskPlan(range(4)), unlike=True)


def test_run_without_workers_ends_with_an_error(monkeypatch):
    monkeypatch.setattr(task_loop, "PATIENCE", 0.0)
    with pytest.raises(DeviceError, match="no worker has started"):
        run_tasks(FakePool([]), TaskPlan(range(4)))
