"""The facts under the verdict of a run: errors, what crosses which link, how much was exercised."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from cosim.core import Fact
from cosim.master import System
from cosim.scenario.gain import Problem
from cosim.scenario.guarantee.wiring import Wiring

if TYPE_CHECKING:
    from cosim.hinf import Result
    from cosim.scenario.guarantee.motion import Motion

_FAR = 10.0
"""A measured gain so many times below the nominal norm needs a reason."""
_NAMED = 4


def facts_of_run(
    design: Result,
    problem: Problem,
    system: System,
    wiring: Wiring,
    motion: Motion | None,
    gain: float | None,
    noise_share: float | None,
    *,
    disturbed: bool,
) -> Iterator[Fact]:
    """Yield the facts under the verdict of a run.

    Parameters
    ----------
    gain : measured in the zero-state run.
    noise_share : of the energy of what acted there, that of the measurements' noise; None where it
        is not known.
    disturbed : something acted there, as far as it is known.
    """
    share = 1.0 if problem.plant is None else problem.plant.envelope_share
    if share < 1.0:
        words = f"{100 * share:.3g} % of the envelope in the vehicle's file"
        yield Fact("proved for", words, known="certified")
    yield from _exercised(design, gain, noise_share, disturbed=disturbed)
    if motion is not None:
        each = (
            f"{name} {error:.3g} {unit}".rstrip() for name, (error, unit) in motion.errors.items()
        )
        yield Fact("error against the set-point at the end", ", ".join(each), known="measured")
    yield from _links(system, wiring)


def _exercised(
    design: Result, gain: float | None, noise_share: float | None, *, disturbed: bool
) -> Iterator[Fact]:
    """Yield how much of the bound the run has tried."""
    norm = design.exact_norm
    if design.gamma is None:
        return
    if gain is None:
        words = "not measured" if disturbed else "no disturbance acted: the bound was not exercised"
        yield Fact("gain of the zero-state run", words, known="measured")
        return
    if not norm or gain * _FAR >= norm:
        return
    times = f"{norm / gain:.3g} times" if gain else "infinitely"
    words = f"{times} below the nominal norm"
    if noise_share is not None and noise_share > 0.5:
        why = f": {100 * noise_share:.3g} % of what acted is noise of the measurements"
    else:
        at = design.norm_frequency
        worst = "" if at is None else f", which is {at:.3g} rad/s"
        why = f": what acted is far from the worst frequency{worst}"
    yield Fact("measured gain", words + why, known="measured")


def _links(system: System, wiring: Wiring) -> Iterator[Fact]:
    """Yield what crosses each link, and whether the proof counts with its age."""
    own = set(wiring.feedback_connections())
    for name in system.links:
        over = [c for c in system.connections if c.link == name]
        if not over:
            continue
        ways: dict[tuple[str, str], list[str]] = {}
        for c in over:
            ways.setdefault((c.source.component, c.target.component), []).append(c.source.variable)
        words = "; ".join(
            f"{_listed(variables)} from {source} to {target}"
            for (source, target), variables in ways.items()
        )
        proved = own & set(over)
        how = "the proof counts with its age" if proved else "no part of the loop that is proved"
        yield Fact(f"over {name}", f"{words}: {how}", known="declared")


def _listed(variables: list[str]) -> str:
    named = ", ".join(variables[:_NAMED])
    return named if len(variables) <= _NAMED else f"{named} and {len(variables) - _NAMED} more"
