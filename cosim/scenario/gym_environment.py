"""A scenario as an environment for reinforcement learning, of gymnasium (the extra `gym`)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import AnyPath, ComponentError, InputError
from cosim.scenario.in_python import Scenario
from cosim.scenario.python_api import open_session

Reals = NDArray[np.float64]


class ScenarioEnvironment(gym.Env[Reals, Reals]):
    """A session of a scenario, by gymnasium's calls.

    An action replaces the inputs from the present communication point on; an observation is of the
    point at the end of the step. Resets return to the start bit for bit, and draw other messages
    of the links only where they are given a seed.

    Attributes
    ----------
    action_space, observation_space : boxes of doubles, of the ranges that the FMUs declare.
    """

    def __init__(
        self,
        scenario: AnyPath | Scenario,
        act: Sequence[str],
        observe: Sequence[str],
        reward: Callable[[Reals, Reals], float],
        points: int,
        fmus: AnyPath,
        flavour: str,
    ) -> None:
        self._scenario, self._fmus, self._flavour = scenario, fmus, flavour
        self._reward, self._points = reward, points
        self._opened = ExitStack()
        self._seed: int | None = None
        self._open()
        self._act, self._observe = self._members(act), self._members(observe)
        self.action_space = self._box(self._act)
        self.observation_space = self._box(self._observe)

    def reset(
        self,
        *,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002 - of gymnasium
    ) -> tuple[Reals, dict[str, Any]]:
        """Return to the start; a seed draws the messages of the links anew."""
        super().reset(seed=seed)
        other = seed is not None and seed != self._seed
        if other or self._session.status == "failed":  # one that failed cannot go back
            self._seed = seed if other else self._seed
            self._open()
        else:
            self._session.restore(self._start)
        return self._observed(), {"t": self._session.time}

    def step(self, action: ArrayLike) -> tuple[Reals, float, bool, bool, dict[str, Any]]:
        """Hold an action for a step; return observation, reward, and whether the run is over.

        It is terminated where the run broke off: an output diverged, an event stopped it; truncated
        at the end of the scenario.
        """
        given = np.asarray(action, np.float64).ravel()
        if given.size != len(self._act):
            raise InputError(
                "an action of another size",
                where="step",
                expected=f"{len(self._act)} numbers: {', '.join(self._act[:8])}",
                got=str(given.size),
            )
        for name, value in zip(self._act, given.tolist(), strict=True):
            self._session[name] = value
        if not self._session.ended:
            with suppress(ComponentError):  # its reason is in what is returned
                self._session.step(self._points)
        status = self._session.status
        # a session that failed has no values any more: those before count
        observed = self._last if status == "failed" else self._observed()
        over = status not in ("running", "finished")
        about = {"t": self._session.time, "status": status, "reason": self._session.reason}
        reward = float(self._reward(observed, given))
        return observed, reward, over, self._session.ended and not over, about

    def close(self) -> None:
        """End the components."""
        self._opened.close()

    def _open(self) -> None:
        self._opened.close()
        settings = [] if self._seed is None else [f"run.seed={self._seed % 2**31}"]
        self._session = self._opened.enter_context(
            open_session(self._scenario, settings=settings, fmus=self._fmus, flavour=self._flavour)
        )
        self._start = self._session.save()

    def _members(self, names: Sequence[str]) -> list[str]:
        """Return single signals, those of groups one by one."""
        return [member for name in names for member in self._session.members(name)]

    def _observed(self) -> Reals:
        self._last = np.array([self._session[name] for name in self._observe], np.float64)
        return self._last

    def _box(self, names: Sequence[str]) -> gym.spaces.Space[Reals]:
        ranges = []
        for name in names:
            component, _, variable = name.partition(".")
            port = self._session.system.components[component].description.ports.get(variable)
            low = None if port is None else port.minimum
            high = None if port is None else port.maximum
            ranges.append((-np.inf if low is None else low, np.inf if high is None else high))
        low, high = np.array(ranges, np.float64).T
        box: gym.spaces.Space[Any] = gym.spaces.Box(low, high, dtype=np.float64)
        return box
