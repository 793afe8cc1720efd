"""How much of a certified gamma is paid for the uncertainty."""

from __future__ import annotations

from dataclasses import replace

from cosim.hinf.analysis import analyse
from cosim.hinf.synthesis import Design, design
from cosim.models import DelaySystem


def without_uncertainty(system: DelaySystem) -> DelaySystem:
    """The nominal system: E and every H removed."""
    delays = tuple(replace(x, H=x.H[:0]) for x in system.delays)
    return replace(system, E=system.E[:, :0], H=system.H[:0], delays=delays)


def nominal_gamma(found: Design) -> float | None:
    """The least certified gamma of the same K at the same k1, k2 or order, nothing uncertain.

    What lies between it and `found.gamma` is paid for E, H; what lies between the exact norm
    and it is the conservatism of the condition. Costs about as much as half a design.

    Returns
    -------
    None where only stability is certified; `found.gamma` where nothing is uncertain.

    Raises
    ------
    NotAchievableError : no proof was found.
    """
    if found.gamma is None or not found.system.E.size:
        return found.gamma
    nominal = without_uncertainty(found.system)
    if found.order is not None:
        return analyse(nominal, found.K, order=found.order).gamma
    return design(nominal, found.k1, found.k2, gain=found.K).gamma
