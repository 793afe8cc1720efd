"""Environments for reinforcement learning; without gymnasium, the extra that is missing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from cosim.core import AnyPath, optional
from cosim.fmu.export import DEFAULT_FLAVOUR
from cosim.scenario.in_python import Scenario
from cosim.scenario.python_api import FMUS

if TYPE_CHECKING:
    from cosim.scenario.gym_environment import ScenarioEnvironment


def env(
    scenario: AnyPath | Scenario,
    *,
    act: Sequence[str],
    observe: Sequence[str],
    reward: Callable[[Any, Any], float],
    points: int = 1,
    fmus: AnyPath = FMUS,
    flavour: str = DEFAULT_FLAVOUR,
) -> ScenarioEnvironment:
    """Open a scenario as an environment of gymnasium: reset, step, close.

        >>> from cosim import DelaySystem, Scenario, env
        >>> system = DelaySystem(A=[[-0.5]], B=[[1]])
        >>> tank = Scenario(step=0.1, until=2).add("tank", system, initial=[1.0])
        >>> e = env(tank, act=["tank.u"], observe=["tank.x"], reward=lambda x, u: -float(x @ x))
        >>> x, about = e.reset(seed=1)
        >>> x, reward, terminated, truncated, about = e.step([-0.5 * x[0]])
        >>> x.shape, -1 < reward < 0, terminated, truncated, about["t"]
        ((1,), True, False, False, 0.1)
        >>> e.close()

    Several side by side: `gymnasium.vector.SyncVectorEnv([lambda: env(...)] * 4)`.

    Parameters
    ----------
    scenario, fmus, flavour : as of `run`.
    act, observe : signals or groups that an action replaces, and signals or groups to observe.
    reward : takes observation and action, arrays of doubles.
    points : number of communication points for which an action is held.

    Raises
    ------
    InputError : as `open_session`; no such signal, or gymnasium is not installed.
    """
    optional("gymnasium", extra="gym", what="environments need gymnasium")
    # an extra: it is loaded by whoever asks for it
    from cosim.scenario.gym_environment import ScenarioEnvironment  # noqa: PLC0415

    return ScenarioEnvironment(scenario, act, observe, reward, points, fmus, flavour)
