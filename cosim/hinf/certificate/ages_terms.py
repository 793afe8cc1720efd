"""What the functional of `ages_proof` consists of: its unknowns and the rows of its inequality.

Each positive delay has one of five functionals:

    constant    the delay is constant, exactly d
    interval    any age from least_age to d, however it varies
    rate        the same, with |age'| <= rate
    wirtinger   sampled: the age is least_age, then grows at rate one to d at most
    looped      the same; sharper, with more unknowns

An age with a known rate is one of any variation as well, and so is a sampled one. The unknowns
and the equations are those of `ages_proof`; docs/explanation/theory.md derives them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

from cosim.core import InputError

if TYPE_CHECKING:
    from cosim.models import Delay, DelaySystem

AgeFunctional = Literal["constant", "interval", "rate", "wirtinger", "looped"]
FUNCTIONALS: tuple[str, ...] = get_args(AgeFunctional)


@dataclass(frozen=True)
class AgeTerms:
    """The part of one positive delay: its functional, and its matrices by name.

    The names and shapes are those of `unknowns_of`; the matrices are arrays of floats from a
    solver, `fmpq_mat` in a proof.
    """

    functional: AgeFunctional
    matrices: dict[str, Any]


@dataclass(frozen=True)
class AgesVariables:
    """The variables: P, the terms of every positive delay, eps and gamma.

    `eps` is one number, or a tuple of one per block of F; None without uncertainty. `gamma` is
    None for stability alone. `down_to_zero` : the claim covers every constant delay up to its
    bound, not exactly the bound (order 0 always does).
    """

    order: int
    P: Any
    terms: tuple[AgeTerms, ...]
    eps: Any
    gamma: Any
    down_to_zero: bool = False

    @property
    def functionals(self) -> tuple[AgeFunctional, ...]:
        """The functional of every positive delay."""
        return tuple(own.functional for own in self.terms)

    def symmetric_matrices(self) -> list[tuple[str, Any]]:
        """Return every matrix that must be symmetric, with its name."""
        found = [("P", self.P)]
        for j, own in enumerate(self.terms):
            found += [(f"{k}[{j}]", M) for k, M in own.matrices.items() if is_symmetric_unknown(k)]
        return found


def late_delays(system: DelaySystem) -> list[Delay]:
    """Return the positive delays; one of zero is none, its term belongs to x(t)."""
    return [delay for delay in system.delays if delay.d > 0]


def choices(delay: Delay) -> tuple[AgeFunctional, ...]:
    """Return the functionals that hold for a positive delay, the sharpest first."""
    if delay.sampled:
        return ("looped", "wirtinger", "interval")
    if delay.rate is not None:
        return ("rate", "interval")
    return ("interval",) if delay.any_age else ("constant",)


def check_functionals(system: DelaySystem, functionals: tuple[str, ...]) -> None:
    """Refuse what does not hold for a delay.

    Raises
    ------
    InputError : naming the delay.
    """
    late = late_delays(system)
    if len(functionals) != len(late):
        raise InputError(
            "one functional per positive delay",
            where="functionals",
            expected=str(len(late)),
            got=str(len(functionals)),
        )
    for j, (own, delay) in enumerate(zip(functionals, late, strict=True)):
        if own not in choices(delay):
            raise InputError(
                "this functional does not hold for the delay",
                where=f"variables.terms[{j}].functional",
                expected=" or ".join(choices(delay)),
                got=str(own),
            )


def rows_of(
    system: DelaySystem, order: int, functionals: tuple[AgeFunctional, ...], *, gamma: bool
) -> dict[str, int]:
    """Return the rows of -Phi by name, in order, without those that one corner adds.

    x(t) is "x", x(t - tau_j) is "x{j}"; "h{j}" and "d{j}" are x(t - least_age), x(t - d);
    "W{j},{k}" the means over the constant part, "a{j}" and "b{j}" those over
    [t - tau, t - least_age] and [t - d, t - tau]; "t{j}" is x(s_k + least_age) and "r{j}"
    x'(t - least_age). `gamma`: with a row for w.
    """
    n = len(system.A)
    names = ["x"]
    for j, (own, delay) in enumerate(zip(functionals, late_delays(system), strict=True)):
        if own == "constant":
            names += [f"x{j}", *(f"W{j},{k}" for k in range(order))]
            continue
        if delay.least_age > 0:
            names += [f"h{j}", *(f"W{j},{k}" for k in range(order))]
        names.append(f"x{j}")
        if own in {"interval", "rate"}:
            names += [f"d{j}", *((f"a{j}", f"b{j}") if order else ())]
        if own == "looped" and delay.least_age > 0:
            names += [f"t{j}", f"r{j}"]
    sizes = dict.fromkeys(names, n)
    if gamma:
        sizes["w"] = system.C.shape[1]
    if system.E.size:
        sizes["p"] = system.E.shape[1]
    return sizes


def state_blocks(
    system: DelaySystem, order: int, functionals: tuple[AgeFunctional, ...]
) -> list[str]:
    """Return the blocks of y in y'P y: "x", then the name and index of each further one."""
    blocks = ["x"]
    for j, (own, delay) in enumerate(zip(functionals, late_delays(system), strict=True)):
        if own == "constant" or delay.least_age > 0:
            blocks += [f"W{j},{k}" for k in range(order)]
        if own == "looped" and delay.least_age > 0:
            blocks.append(f"h{j}")
        if own == "interval" and order:
            blocks.append(f"ab{j}")
        if own == "rate" and order:
            blocks += [f"a{j}", f"b{j}"]
    return blocks


def unknowns_of(
    system: DelaySystem, order: int, functionals: tuple[AgeFunctional, ...], *, gamma: bool
) -> list[dict[str, tuple[int, int]]]:
    """Return the name and shape of the matrices of every positive delay.

    All are symmetric but M, X_b and Y (`is_symmetric_unknown`).
    """
    n = len(system.A)
    rows = sum(rows_of(system, order, functionals, gamma=gamma).values())
    found = []
    for own, delay in zip(functionals, late_delays(system), strict=True):
        names: dict[str, tuple[int, int]] = {}
        first = own == "constant" or delay.least_age > 0
        if first:
            names |= {"Q": (n, n), "R": (n, n)}
        if own in {"interval", "rate"}:
            m = 2 * n if order else n
            names |= {"S": (n, n)} if own == "interval" else {"S_1": (n, n), "S_2": (n, n)}
            names |= {"Z": (n, n), "M": (m, m)}
        if own == "wirtinger":
            names["W"] = (n, n)
        if own == "looped":
            m = 2 * n if first else n
            names |= {"N": (n, n)} if first else {}
            names |= {"U": (m, m), "X_a": (m, m), "X_b": (m, m), "Y": (rows, m)}
        found.append(names)
    return found


def is_symmetric_unknown(name: str) -> bool:
    """Whether the unknown of that name is a symmetric matrix."""
    return name not in {"M", "X_b", "Y"}
