"""Prove the gains of an existing design for ages that what is held between messages can have.

K and L stay, double by double; nothing is searched but the proof. Where the design takes a
measurement, a feedback or a command to be of a constant age d, the new proof is for any age up to
d; where it takes it to act at once, for any age up to one that is given.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cosim.core import PLANT_NOTE, InputError, NotAchievableError
from cosim.hinf.certificate import constant_ages_claimed, has_constant_age
from cosim.hinf.synthesis.analysis import Order
from cosim.hinf.synthesis.conditions import is_large
from cosim.hinf.synthesis.gain_design import design
from cosim.hinf.synthesis.output_feedback import design_output_feedback
from cosim.hinf.synthesis.result import Result
from cosim.models import Delay, DelaySystem, Measurement


def proved_again(proved: Result, *, hold: float | None = None, order: Order = "auto") -> Result:
    """Return the same gains, with a proof for ages that a run can have.

    Parameters
    ----------
    proved : a design; one whose ages are already such is proved again as it is.
    hold : greatest age [s], at the end of its use, of what acts at once in `proved`: of commands,
        of a state feedback, of measurements without an age.
    order : of the analysis.

    Raises
    ------
    InputError : something acts at once, and `hold` is missing or not positive.
    NotAchievableError : the gains are not proved for these ages.
    """
    if hold is not None and not (np.isfinite(hold) and hold > 0):
        raise InputError("not an age", where="hold", expected="seconds > 0", got=repr(hold))
    at_once = [name for name, d in constant_ages_claimed(proved.certificate).items() if d == 0]
    if at_once and hold is None:
        raise InputError(
            f"at once in the certificate, but held in a run: {', '.join(at_once)}",
            where="hold",
            expected="the greatest age at the end of its use, in seconds",
            hint="a controller that commands at every step of 0.05 s: 0.1, a step and the coupling",
        )
    again = _proved(proved, hold, order)
    note = proved.certificate.get(PLANT_NOTE)
    if note is None:
        return again
    return replace(again, certificate={**again.certificate, PLANT_NOTE: note})


_SHARES = (0.5, 0.2, 0.1, 0.05, 0.02)
"""Ages of commands that are tried, as shares of the least age of a measurement."""
_COST = 1.25
"""So much greater may gamma be for commands that are held than for commands at once."""


def for_any_command(proved: Result, *, most: float | None = None) -> Result:
    """Return a design proved for commands of any age up to one that costs little.

    Commands at once are of no run: they are held from one to the next. So the greatest of some ages
    is taken, half the least age of a measurement at most, for which gamma is not a quarter greater.
    The design itself where there is none, where its ages are no others, of a large pair, whose
    proof takes minutes, and with peaks, which are proved from the design alone.

    most : greatest gamma, in place of a quarter more than that of the design.
    """
    ages = constant_ages_claimed(proved.certificate)
    least = min((x.d for x in proved.measurements if x.d > 0), default=0.0)
    large = is_large(proved.pair.system, proved.pair.gain)
    peaks = proved.guarantees.state_peaks
    if not ages or any(ages.values()) or not least or large or peaks is not None:
        return proved
    for share in _SHARES:
        try:
            again = proved_again(proved, hold=float(f"{share * least:.3g}"))
        except NotAchievableError:
            continue
        bound = most or _COST * (proved.gamma or 0.0)
        cheap = again.gamma is None or again.gamma <= bound
        if cheap:
            return again
    return proved


def _proved(proved: Result, hold: float | None, order: Order) -> Result:
    if proved.observer is None:
        return design(
            _of_any_age(proved.system, hold), gain=proved.K, order=order, alternatives=False
        )
    pair = proved.pair
    return design_output_feedback(
        *(pair.plant, [_measured(x, hold) for x in pair.measurements]),
        gain=pair.K,
        injections=pair.L,
        command_age=pair.command_age if pair.command_age > 0 else hold or 0.0,
        command_any_age=True,
        estimated=pair.estimated.tolist(),
        order=order,
    )


def _measured(x: Measurement, hold: float | None) -> Measurement:
    """Return a measurement whose age varies."""
    if not has_constant_age(x):
        return x
    return replace(x, d=x.d if x.d > 0 else hold or 0.0, any_age=True, rate=None)


def _of_any_age(system: DelaySystem, hold: float | None) -> DelaySystem:
    """Return a system whose feedback is of any age; its other delays stay as they are."""
    at_once, *delayed = system.selections
    zero = np.zeros_like(system.A)
    delays: list[Delay] = []
    for x, acting in zip(system.delays, delayed, strict=True):
        if not acting.any() or not has_constant_age(x):
            delays.append(x)
            continue
        inside = bool(x.A.any() or x.H.any())  # the plant has the same delay, as it is
        delays += [replace(x, feedback=False)] if inside else []
        d = x.d if x.d > 0 else hold or 0.0
        delays.append(Delay(d, zero, None, x.feedback, True, least_age=x.least_age))  # noqa: FBT003
    if at_once.any():
        of_whole_state = system.feedback is None
        acting_now = True if of_whole_state else system.feedback
        delays.append(Delay(hold or 0.0, zero, None, acting_now, True))  # type: ignore[arg-type]  # noqa: FBT003
    return replace(system, delays=tuple(delays), feedback=None)
