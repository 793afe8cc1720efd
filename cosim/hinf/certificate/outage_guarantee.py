"""Proved growth and decay of a loop whose link drops out: the guarantee, its words and its JSON.

The inequalities are those of `cosim.hinf.theorems.outages`.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Self

from cosim.core import InputError
from cosim.hinf.certificate.decay import is_above_exponential
from cosim.hinf.certificate.guarantee import DOUBLE, NUMBER, ROWS, Form, Guarantee, Read, numbers
from cosim.hinf.certificate.system_json import known_keys
from cosim.hinf.certificate.system_parts import matrix_from_rows
from cosim.hinf.certificate.unknowns_json import (
    Counts,
    blocks_in,
    unknowns_from_json,
    unknowns_to_json,
)
from cosim.hinf.certificate.words import PROPERTIES
from cosim.hinf.exact import exact, from_text, to_text
from cosim.hinf.theorems import (
    Modes,
    Shape,
    first_failure,
    not_symmetric,
    outage_inequalities,
    positive_delays,
    require_size,
    shapes_of,
    with_inverse_of_gamma,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from cosim.models import Delay, DelaySystem, Matrix


def _fallback(data: Any, of: Read) -> Matrix:
    fallback, expected = matrix_from_rows(data, of.where), of.gain.shape
    if fallback.shape != expected:
        got = str(fallback.shape)
        raise InputError("wrong shape", where=of.where, expected=str(expected), got=got)
    return fallback


@dataclass(frozen=True, eq=False)
class Outages(Modes, Guarantee):
    """What is proved of a loop whose link drops out; exact numbers (`fmpq`, `fmpq_mat`).

    unknowns : of `outage_inequalities` by name: P, S[j], R[j], M[j], eps[b], eps_out[b].
    """

    unknowns: Mapping[str, Any]

    @property
    def share(self) -> Any:
        """The share of the time in touch above which V falls in the long run (`fmpq`)."""
        return self.beta / (self.alpha + self.beta) if self.beta > 0 else 0 * self.beta

    NAME = "outages"
    FORMS = MappingProxyType(
        {
            "alpha": NUMBER,
            "beta": NUMBER,
            "rho": numbers(lambda of: len(positive_delays(of.system))),
            "fallback": Form(ROWS.write, _fallback),
            "fallback_age": DOUBLE,
        }
    )
    CLAIMED = ("alpha", "beta", "fallback", "fallback_age")

    def claim(self) -> dict[str, Any]:
        """Return the claim that is proved if `failure` returns None."""
        claim = super().claim() | {"share": to_text(self.share)}
        if self.gamma is not None:
            more = PROPERTIES["outages with a gain"]
            claim |= {"property": claim["property"] + more, "gamma": to_text(self.gamma)}
        return claim

    def to_json(self) -> dict[str, Any]:
        """Return the JSON values that `from_json` reads."""
        return {
            **super().to_json(),
            "gamma": None if self.gamma is None else to_text(self.gamma),
            **unknowns_to_json(self.unknowns, _counts(len(self.rho), blocks_in(self.unknowns))),
        }

    @classmethod
    def from_json(cls, data: Any, system: DelaySystem, gain: Matrix, where: str) -> Self:
        """Read what `to_json` wrote of a loop; messages name `where`.

        Raises
        ------
        InputError : a missing key, a wrong shape, a text that is no number, or a loop without
            outages.
        """
        counts = _counts(len(positive_delays(system)), len(system.blocks))
        keys = (*cls.FORMS, "gamma", *counts)
        known_keys(data, where, keys, required=keys)
        outage_delay(system)
        gamma = data["gamma"]
        if gamma is not None and not system.has_performance:
            raise InputError("this system has no gain to bound", where=f"{where}.gamma")
        gamma = None if gamma is None else from_text(gamma, f"{where}.gamma")
        modes = Modes(**cls._values(data, system, gain, where), gamma=gamma)
        shapes = shapes_of_outages(system, gain, modes)
        return cls(**vars(modes), unknowns=unknowns_from_json(data, shapes, counts, where))

    def failure(self, system: DelaySystem, gain: Matrix) -> str | None:
        """Return which condition is not proved; None if all are.

        Raises
        ------
        InputError : a loop without outages (`outage_delay`), or too large a proof.
        """
        reason = self._failure_of_numbers(system, outage_delay(system))
        if reason is not None:
            return reason
        name = not_symmetric(shapes_of_outages(system, gain, self), self.unknowns)
        if name is not None:
            return f"{name} is not symmetric"
        values = with_inverse_of_gamma({**self.unknowns, "gamma": self.gamma})
        return first_failure(outage_inequalities(system, gain, self), values)

    def _failure_of_numbers(self, system: DelaySystem, feedback: Delay) -> str | None:
        """Return what is wrong with a number; None if nothing is."""
        if not (self.alpha > 0 and self.beta >= -self.alpha):
            return "alpha is not positive, or beta is below -alpha"
        if self.gamma is not None and not self.gamma > 0:
            return "gamma is not positive"
        if not 0 <= self.fallback_age <= feedback.d:
            return "the age of the fallback is not between 0 and that of the feedback"
        for j, (r, delay) in enumerate(zip(self.rho, positive_delays(system), strict=True)):
            if not (r > 0 and is_above_exponential(1 / r, 2 * self.alpha * exact(delay.d))):
                return f"rho[{j}] is not positive, or not at most exp(-2 alpha d)"
        return None


def _counts(delays: int, blocks: int) -> Counts:
    each = dict.fromkeys(("S", "R", "M"), delays)
    return {"P": None, **each, "eps": blocks, "eps_out": blocks}


def shapes_of_outages(system: DelaySystem, gain: Matrix, modes: Modes) -> dict[str, Shape]:
    """Return the shape of every unknown by its name.

    Raises
    ------
    InputError : more than `MAX_ROWS` rows.
    """
    rows = len(system.A) * (1 + 2 * len(system.delays))
    require_size(rows + system.C.shape[1] + system.E.shape[1])
    shapes = shapes_of(outage_inequalities(system, gain, modes))
    return {name: shape for name, shape in shapes.items() if not name.endswith("gamma")}


def outage_delay(system: DelaySystem) -> Delay:
    """Return the delay through which the control acts, which an outage cuts.

    Raises
    ------
    InputError : no control acts through a positive delay, or not all of it through one, or
        something else acts through it.
    """
    acting = [x for x in system.delays if x.feedback and x.d > 0]
    wrong = None
    if not acting:
        wrong = "no control acts through a positive delay"
    elif acting[0].feedback is not True or system.is_structured:
        wrong = "states that are fed back at different ages, or not at all"
    elif acting[0].A.any() or acting[0].H.any():
        wrong = "the plant itself acts through the delay of the feedback"
    if wrong is not None:
        raise InputError(
            "outages are those of one link with all of the feedback",
            where=f"system {system.name}" if system.name else "system",
            expected="u = K x(t - d) with one positive delay, through which nothing else acts",
            got=wrong,
        )
    return acting[0]
