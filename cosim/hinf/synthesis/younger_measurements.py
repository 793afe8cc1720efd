"""What could be done in place of an output feedback that is refused: younger measurements.

As in `alternatives`: whatever is named was designed and proved by the call that was refused, with
nothing else changed. The ages of all measurements and of the command are shortened together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from cosim.core import NotAchievableError, at_least, report
from cosim.hinf.synthesis.alternatives import gamma_to_have
from cosim.hinf.synthesis.result import Result
from cosim.models import Measurement

_SHARES = (0.5, 0.2, 0.05)
"""Of the ages, tried in turn."""
_DIGITS = 2
_ABOVE = (0.01,)
"""Of the least gamma, which is asked for once: each of these designs takes long."""

DesignWith = Callable[[Sequence[Measurement], float, float | None], Result]
"""The design that was refused, with other measurements, age of the command [s] and gamma."""


def name_younger(
    error: NotAchievableError,
    measurements: Sequence[Measurement],
    command_age: float,
    gamma: float | None,
    design_with: DesignWith,
) -> None:
    """Say in the error of a refused output feedback which gamma, or which ages, can be had."""
    have = []
    if gamma is not None:
        error.gamma = gamma_to_have(
            gamma, lambda bound: design_with(measurements, command_age, bound), _ABOVE
        )
        have += [] if error.gamma is None else [f"gamma = {error.gamma:g}, which is certified"]
    younger = first_younger(measurements, command_age, lambda m, age: design_with(m, age, gamma))
    if younger is not None:
        have.append(f"{younger}, with which it is certified")
    elif any(x.d > 0 for x in measurements) or command_age > 0:
        error.got = f"{error.got}; nor is it with ages of {_SHARES[-1]:g} of these"
    if have:
        error.hint = ", or ".join(have)


def first_younger(
    measurements: Sequence[Measurement],
    command_age: float,
    design_with: Callable[[Sequence[Measurement], float], Result],
) -> str | None:
    """Return the first ages, in words, at which a design with younger measurements is certified."""
    if not (command_age > 0 or any(x.d > 0 for x in measurements)):
        return None
    for number, share in enumerate(_SHARES):
        report("looking for ages that can be certified", number / len(_SHARES))
        younger = [
            replace(x, d=_shorter(x.d, share), least_age=_shorter(x.least_age, share))
            for x in measurements
        ]
        age = _shorter(command_age, share)
        try:
            design_with(younger, age)
        except NotAchievableError:
            continue
        ages = [f"{x.name} of at most {x.d:g} s" for x in younger if x.d > 0]
        ages += [f"a command of at most {age:g} s"] if age > 0 else []
        return f"younger measurements ({', '.join(ages)})"
    return None


def _shorter(age: float, share: float) -> float:
    return float(at_least(share * age, _DIGITS)) if age > 0 else age
