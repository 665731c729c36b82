# SPDX-License-Identifier: Apache-2.0
"""LookAround, the environment of Gymnasium. Each test uses the library itself."""

import numpy as np
import pytest

from tests.learning.small_course import scenario
from tiscene.errors import ArgumentError, ArgumentTypeError
from tiscene.scene.camera import Camera


@pytest.fixture(scope="module")
def environment():
    gymnasium = pytest.importorskip("gymnasium")
    env = gymnasium.make(
        "tiscene.learning.adapters.look_around:LookAround-v0",
        scenario=scenario("Ball 01"),
        width=32,
        height=24,
        spp=1,
        length=9,
        budget=2,
    )
    yield env
    env.close()


@pytest.mark.filterwarnings("ignore:.*The environment .* is different from the unwrapped:UserWarning")
def test_environment_passes_gymnasiums_checker(environment):
    checker = pytest.importorskip("gymnasium.utils.env_checker")
    checker.check_env(environment.unwrapped, skip_render_check=True)


def test_episodes_of_equal_actions_are_equal(environment):
    def episode():
        observation, info = environment.reset(seed=1)
        seen = [observation["rgb"].tobytes()]
        for action in (2, 2, 1, 4, 6, 3, 0, 5):
            observation, reward, ended, truncated, info = environment.step(action)
            seen.append((observation["rgb"].tobytes(), reward, ended, truncated, info["position"]))
        return seen

    assert episode() == episode()


def test_function_of_a_seed_gives_each_episode_its_scenario():
    gymnasium = pytest.importorskip("gymnasium")
    from tiscene.learning.adapters.look_around import LookAround

    asked = []

    def drawn(seed):
        asked.append(seed)
        return scenario("Cube" if seed % 2 else "Ball 01")

    settings = {"width": 24, "height": 18, "spp": 1, "incremental": False}
    with pytest.raises(ArgumentError, match="categories: name them for all scenarios"):
        LookAround(drawn, **settings)
    settings["categories"] = ("ball", "cube")
    with pytest.raises(ArgumentError, match="camera='Main': give it to the scenarios"):
        LookAround(drawn, camera="Main", **settings)
    envs = gymnasium.vector.SyncVectorEnv([lambda: LookAround(drawn, **settings)] * 2)
    assert envs.single_observation_space["label"].n == 3
    asked.clear()
    first = [envs.reset(seed=seed)[0]["rgb"] for seed in (2, 3, 2)]
    assert asked == [2, 3, 3, 4, 2, 3]
    assert (first[0] == first[2]).all()
    assert (first[0] == first[1][::-1]).all()
    assert (first[0][0] != first[0][1]).any()
    envs.reset()
    envs.reset(seed=2)
    envs.reset()
    assert asked[6:8] == asked[10:]  # drawn anew, by the seed before
    envs.close()


def test_options_of_an_episode_are_refused(environment):
    with pytest.raises(ArgumentError, match=r"options=.*LookAround has none; pass arguments to gymnasium.make"):
        environment.reset(options={"length": 3})
    environment.reset(options={})


def test_changed_observation_does_not_change_the_environment(environment):
    observation, _ = environment.reset()
    before = environment.unwrapped._frame.rgb.copy()
    observation["rgb"][:] = 7
    assert np.array_equal(environment.unwrapped._frame.rgb, before)


def test_turns_cancel_out_and_steps_move_level(environment):
    _, info = environment.reset()
    start = info["position"], info["rotation"]
    for action in (2, 3, 4, 5):
        info = environment.step(action)[4]
    assert np.allclose(info["rotation"], start[1], atol=1e-9)
    assert info["position"] == start[0]
    environment.step(4)
    moved = environment.step(1)[4]["position"]
    assert np.linalg.norm(np.subtract(moved, start[0])) == pytest.approx(0.2)
    assert moved[1] == pytest.approx(start[0][1])


def test_questions_are_paid_and_first_answers_rewarded(environment):
    """The camera looks at the center of the ball's path, so that a question names the ball at some frame."""
    observation, info = environment.reset()
    rewards, labels = [], []
    for _ in range(9):
        observation, reward, ended, truncated, info = environment.step(6)
        rewards.append(round(reward, 6))
        labels.append(int(observation["label"]))
    assert info["asked"] == 2
    assert rewards[2:] == [0.0] * 7
    first = 0.9 if labels[0] else -0.1
    assert rewards[0] == first
    assert truncated
    assert not ended


def test_a_step_forward_is_remembered_until_the_episode_ends(environment):
    inner = environment.unwrapped
    environment.reset()
    environment.step(2)
    assert not inner._walks
    environment.step(1)
    assert inner._walks <= {0, 2}
    assert inner._walks
    environment.reset()
    assert not inner._walks


def test_environment_needs_a_scenario():
    pytest.importorskip("gymnasium")
    from tiscene.learning.adapters.look_around import LookAround

    with pytest.raises(ArgumentError, match="pass a Scenario"):
        LookAround()
    for name, value in (("length", 0), ("length", 2.5), ("turn", "a"), ("clearance", float("nan")), ("budget", -1)):
        with pytest.raises(ArgumentError, match=f"{name}={value!r}: must"):
            LookAround("object_view", **{name: value})
    with LookAround("object_view", width=16, height=12, render_mode="rgb_array") as new:
        for call in (lambda: new.step(0), new.render):
            with pytest.raises(ArgumentError, match="call reset"):
                call()
        new.reset()
        with pytest.raises(ArgumentTypeError, match="must be one whole number, not an array"):
            new.step(np.array([3]))


def test_scenarios_of_wrong_types_are_named():
    pytest.importorskip("gymnasium")
    from tiscene.learning.adapters.look_around import LookAround

    with pytest.raises(ArgumentError, match=r"scenario=\['room_02'\]: must be a Scenario, a scene's name, a file, or"):
        LookAround(["room_02"])
    with pytest.raises(ArgumentError, match="scenario: the function returned 'room_02' of seed 0; it must return a Sc"):
        LookAround(lambda seed: "room_02", categories=("chair",))


@pytest.mark.parametrize(
    ("argument", "cure"),
    [
        ({"frames": 3}, "pass `length`"),
        ({"prefetch": 2}, "ahead"),
        ({"batch": 2}, "ahead"),
        ({"buffers": ("rgb",)}, "have"),
    ],
)
def test_arguments_without_effect_on_the_environment_are_refused(argument, cure):
    pytest.importorskip("gymnasium")
    from tiscene.learning.adapters.look_around import LookAround

    with pytest.raises(ArgumentError, match=f"{next(iter(argument))}=.*{cure}"):
        LookAround("object_view", **argument)


@pytest.mark.parametrize(
    ("argument", "hint"),
    [
        ("qualty", "did you mean 'quality'"),
        ("lenght", "did you mean 'length'"),
        ("action", "there are scenario, .*length.*quality"),
    ],
)
def test_unknown_arguments_of_the_environment_are_named_with_those_that_there_are(argument, hint):
    pytest.importorskip("gymnasium")
    from tiscene.learning.adapters.look_around import LookAround

    with pytest.raises(ArgumentError, match=f"LookAround has no such argument; {hint}") as caught:
        LookAround("object_view", **{argument: "fast"})
    assert str(caught.value).startswith(f"{argument}: ")
    assert "prefetch" not in str(caught.value)


def test_environment_with_several_cameras_is_refused():
    pytest.importorskip("gymnasium")
    from tiscene.learning.adapters.look_around import LookAround

    cameras = [Camera((0, 1, 0), (1, 0, 0, 0), 1.0, "Left"), Camera((0, 1, 2), (1, 0, 0, 0), 1.0, "Right")]
    with pytest.raises(ArgumentError, match=r"one camera, not 2 \(Left, Right\): pass one as camera="):
        LookAround("object_view", camera=cameras)


@pytest.mark.parametrize("action", [7, -1, 2.5, "left"])
def test_unknown_actions_are_refused(environment, action):
    environment.reset()
    with pytest.raises(ArgumentError, match=f"action={action!r}: must be"):
        environment.unwrapped.step(action)


def test_tiny_pictures_can_step_forward():
    pytest.importorskip("gymnasium")
    from tiscene.learning.adapters.look_around import LookAround

    env = LookAround(scenario("Ball 01"), width=3, height=3, spp=1)
    _, before = env.reset()
    _, _, _, _, after = env.step(1)
    env.close()
    assert np.linalg.norm(np.subtract(after["position"], before["position"])) == pytest.approx(env.stride)
