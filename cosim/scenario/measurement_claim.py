"""Which ages of its measurements a design with an observer is about, and whether a run had them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from cosim.scenario.age_claim import age_assumptions, age_figures

if TYPE_CHECKING:
    from cosim.hinf import OutputFeedback
    from cosim.models import Delay
    from cosim.scenario.age import MeasuredAges

_CLOSE = 1e-12
COMMANDS = "commands"
"""Entry of the figures, beside those of the measurements."""


def measurement_assumptions(
    design: OutputFeedback,
    ages: Mapping[str, MeasuredAges | None],
    command_age_ns: int | None,
    step_ns: int,
    *,
    substituted: bool,
) -> dict[str, bool]:
    """Return what the proof assumes of the age of each measurement and of the commands, by name.

    Parameters
    ----------
    ages : measured, by the name of the measurement.
    command_age_ns : the greatest age of a command in use; None where none was.
    step_ns : communication step [ns].
    substituted : whether a link used a substitute for a lost message.
    """
    found: dict[str, bool] = {}
    for name, delay in _delays(design).items():
        measured = ages.get(name)
        found[f"age_of_{name}_within_design"] = (
            measured is not None
            and (measured.least_ns or 0) >= 0
            and measured.greatest_ns / 1e9 <= delay.d * (1 + _CLOSE)
            and not substituted
        )
        of_kind = age_assumptions(delay, measured, None, step_ns)
        of_kind.pop("links_justify_sampled_age", None)
        found |= {
            f"age_of_{name}_{key.removeprefix('message_age_')}": met for key, met in of_kind.items()
        }
    found[f"age_of_{COMMANDS}_within_design"] = (
        command_age_ns is not None
        and command_age_ns <= _command_bound_ns(design, step_ns) * (1 + _CLOSE)
    )
    return found


def _command_bound_ns(design: OutputFeedback, step_ns: int) -> float:
    """Return the greatest age of a command [ns]; a constant one holds up to the steps."""
    return design.pair.command_age * 1e9 + (0 if design.pair.command_any_age else 2 * step_ns)


def measurement_age_figures(
    design: OutputFeedback, ages: Mapping[str, MeasuredAges | None], command_age_ns: int | None
) -> dict[str, Any]:
    """Return by measurement the ages assumed and measured, and those of the commands; JSON-safe."""
    found: dict[str, Any] = {
        name: age_figures(delay, ages.get(name), None) for name, delay in _delays(design).items()
    }
    measured = None if command_age_ns is None else {"greatest_s": command_age_ns / 1e9}
    age = design.pair.command_age
    kind = f"any age up to {age:.6g} s" if design.pair.command_any_age else f"constant, {age:.6g} s"
    found[COMMANDS] = {
        "assumed": f"{kind}, from the estimate to its use, but for steps",
        "greatest_s": age,
        "measured": measured,
    }
    return found


def _delays(design: OutputFeedback) -> dict[str, Delay]:
    """Return what is known of the age of each measurement."""
    n = len(design.system.A)
    return {each.name: each.delay(n) for each in design.measurements}
