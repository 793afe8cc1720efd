"""A scenario as an environment of gymnasium."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from shared import fmu_store

from cosim import Component, Scenario, env
from cosim.core import InputError

LOSSY = Scenario.load("auv-acoustic").set("run.end", 2.0)


def opened(scenario: Any = LOSSY, **more: Any) -> Any:
    keys: dict[str, Any] = {
        "act": ["plant.force"],
        "observe": ["plant.eta", "plant.nu.u"],
        "reward": lambda x, u: -float(x @ x) - 0.01 * float(u @ u),
    }
    return env(scenario, fmus=fmu_store("native"), **{**keys, **more})


@pytest.fixture
def environment() -> Iterator[Any]:
    made = opened()
    yield made
    made.close()


@pytest.mark.filterwarnings("ignore:.*Box.*:UserWarning", "ignore:.*infinity.*:UserWarning")
def test_it_is_as_gymnasium_wants_one(environment: Any) -> None:
    check_env(environment, skip_render_check=True, skip_close_check=True)


def test_an_episode_ends_with_the_scenario_and_begins_again_bit_for_bit(environment: Any) -> None:
    """What is observed is what the session has; the reward is of that and of the action."""
    episodes = []
    for _ in range(2):
        first, about = environment.reset()
        rows, done, terminated = [first], False, False
        assert about["t"] == 0.0
        while not done:
            action = np.array([10.0, 0.0, -1.0])
            observed, reward, terminated, truncated, about = environment.step(action)
            assert reward == -float(observed @ observed) - 0.01 * 101.0
            rows.append(observed)
            done = terminated or truncated
        assert (terminated, about["status"], about["t"]) == (False, "finished", 2.0)
        episodes.append(np.array(rows))
    assert np.array_equal(*episodes)
    assert episodes[0].shape[1] == 5


def test_a_seed_draws_the_messages_anew() -> None:
    """Of a loop that the link decides about: the command is left alone."""
    made = opened(act=["plant.disturbance.u"], observe=["plant.eta"])

    def flight(seed: int | None) -> list[float]:
        made.reset(seed=seed)
        return [float(made.step([0.0])[0][0]) for _ in range(40)]

    first, again, other = flight(1), flight(None), flight(7)
    made.close()
    assert first == again
    assert first != other


def test_several_fly_side_by_side() -> None:
    side = gym.vector.SyncVectorEnv([opened, opened])
    observed, _ = side.reset(seed=3)
    assert observed.shape == (2, 5)
    assert side.step(np.zeros((2, 3)))[1].shape == (2,)
    side.close()


def test_a_run_that_breaks_off_is_terminated() -> None:
    stopping = LOSSY.when("t > 0.5 s", stop="enough")
    made = opened(stopping, points=20)
    made.reset()
    *_, terminated, truncated, about = made.step(np.zeros(3))
    made.close()
    assert (terminated, truncated, about["status"]) == (True, False, "stopped")


def test_what_is_no_signal_or_no_action_is_refused(environment: Any) -> None:
    with pytest.raises(InputError, match="no variable 'farce'"):
        opened(act=["plant.farce"])
    environment.reset()
    with pytest.raises(InputError, match="an action of another size"):
        environment.step(np.zeros(2))


def test_a_run_that_failed_begins_again() -> None:
    """A component in Python that breaks: the next episode is opened anew."""

    class Breaks(Component):
        inputs, outputs = {"u": 1}, {"y": 1}

        def step(self, t: float, dt: float, u: Any) -> Any:  # noqa: ARG002
            return {"y": 1.0 / (u["u"][0] - 1.0)}

    made = opened(Scenario(step=0.1, until=1).add("it", Breaks), act=["it.u"], observe=["it.y"])
    made.reset()
    assert made.step([3.0])[0].tolist() == [0.5]
    *_, terminated, _, about = made.step([1.0])
    assert (terminated, about["status"]) == (True, "failed")
    assert made.reset()[0].tolist() == [0.0]
    assert made.step([3.0])[0].tolist() == [0.5]
    made.close()
