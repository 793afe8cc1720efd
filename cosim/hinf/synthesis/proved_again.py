"""Prove the gains of an existing design for ages that what is held between messages can have.

K and L stay, double by double; nothing is searched but the proof. Where the design takes a
measurement, a feedback or a command to be of a constant age d, the new proof is for any age up to
d; where it takes it to act at once, for any age up to one that is given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cosim.core import PLANT_NOTE, InputError, NotAchievableError
from cosim.hinf.certificate import cannot_be_held, constant_ages_of_held
from cosim.hinf.synthesis.analysis import Order
from cosim.hinf.synthesis.certified_design import Design
from cosim.hinf.synthesis.certified_pair import OutputFeedback
from cosim.hinf.synthesis.gain_design import design
from cosim.hinf.synthesis.output_feedback import design_output_feedback
from cosim.models import Delay, DelaySystem, Measurement


def proved_again(
    found: Design | OutputFeedback, *, held: float | None = None, order: Order | None = None
) -> Design | OutputFeedback:
    """Return the same gains, with a proof for ages that a run can have.

    Parameters
    ----------
    found : a design; one whose ages are already such is proved again as it is.
    held : greatest age [s], at the end of its use, of what acts at once in `found`: of commands,
        of a state feedback, of measurements without an age.
    order : of the analysis; None: that of the proof of `found`, then "auto".

    Raises
    ------
    InputError : something acts at once, and `held` is missing or not positive.
    NotAchievableError : the gains are not proved for these ages.
    """
    if held is not None and not (np.isfinite(held) and held > 0):
        raise InputError("not an age", where="held", expected="seconds > 0", got=repr(held))
    at_once = [name for name, d in constant_ages_of_held(found.certificate).items() if d == 0]
    if at_once and held is None:
        raise InputError(
            f"at once in the certificate, but held in a run: {', '.join(at_once)}",
            where="held",
            expected="the greatest age at the end of its use, in seconds",
            hint="a controller that commands at every step of 0.05 s: 0.1, a step and the coupling",
        )
    orders: list[Order] = ["auto"] if order is None else [order]
    if order is None and found.order is not None:
        orders.insert(0, found.order)
    again = _first(lambda own: _proved(found, held, own), orders)
    note = found.certificate.get(PLANT_NOTE)
    if note is None:
        return again
    return replace(again, certificate={**again.certificate, PLANT_NOTE: note})


def _first(
    prove: Callable[[Order], Design | OutputFeedback], orders: list[Order]
) -> Design | OutputFeedback:
    """Return the proof of the first of some orders that has one."""
    for own in orders[:-1]:
        try:
            return prove(own)
        except NotAchievableError:
            continue
    return prove(orders[-1])


def _proved(
    found: Design | OutputFeedback, held: float | None, order: Order
) -> Design | OutputFeedback:
    if isinstance(found, Design):
        return design(_of_any_age(found.system, held), gain=found.K, order=order)
    pair = found.pair
    return design_output_feedback(
        *(pair.plant, [_measured(x, held) for x in pair.measurements]),
        gain=pair.K,
        injections=pair.L,
        command_age=pair.command_age if pair.command_age > 0 else held or 0.0,
        command_any_age=True,
        estimated=pair.estimated.tolist(),
        order=order,
    )


def _measured(x: Measurement, held: float | None) -> Measurement:
    """Return a measurement whose age varies."""
    if not cannot_be_held(x):
        return x
    return replace(x, d=x.d if x.d > 0 else held or 0.0, any_age=True, rate=None)


def _of_any_age(system: DelaySystem, held: float | None) -> DelaySystem:
    """Return a system whose feedback is of any age; its other delays stay as they are."""
    at_once, *late = system.selections
    zero = np.zeros_like(system.A)
    delays: list[Delay] = []
    for x, acting in zip(system.delays, late, strict=True):
        if not acting.any() or not cannot_be_held(x):
            delays.append(x)
            continue
        inside = bool(x.A.any() or x.H.any())  # the plant has the same delay, as it is
        delays += [replace(x, feedback=False)] if inside else []
        d = x.d if x.d > 0 else held or 0.0
        delays.append(Delay(d, zero, None, x.feedback, True, least_age=x.least_age))  # noqa: FBT003
    if at_once.any():
        whole = system.feedback is None
        acting_now = True if whole else system.feedback
        delays.append(Delay(held or 0.0, zero, None, acting_now, True))  # type: ignore[arg-type]  # noqa: FBT003
    return replace(system, delays=tuple(delays), feedback=None)
