"""Systems with another feedback: fewer measured states, integral action.

**Integral action.** The controller integrates what it receives, u = K x(t-tau) + K_i xi(t) with

    xi'(t) = S sum_i S_i x(t-tau_i),

each state as late as it is fed back. The augmented system has the state (x, xi) and the same form,
with xi fed back at once or through a delay of its own, so that design, analysis and certificate
are those of any system with feedback of single states. xi is also an output, z_xi = weight * xi:
without it nothing would ask for an integral. For a loop that is stable with xi in it, a constant
disturbance and constant F leave S x -> 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cosim.core import InputError
from cosim.models import Delay, DelaySystem, Matrix

_SHARE = 0.1  # of the rate 1/d: the weight of an integral beside that of its state


def with_measured(system: DelaySystem, states: Sequence[int]) -> DelaySystem:
    """Return the system with only these states fed back, each as it was.

    Parameters
    ----------
    states : indices from 0; the other columns of K are zero.

    Raises
    ------
    InputError : a state that does not exist, or that is not fed back.
    """
    n = len(system.A)
    _refuse_masks(system, "measured")
    _check_states(states, n, "measured")
    keep = np.isin(np.arange(n), list(states))
    lost = [j for j in states if not system.measured[j]]
    if lost:
        raise InputError(
            "this state is not fed back by the system",
            where="measured",
            expected=_listed(np.flatnonzero(system.measured)),
            got=str(lost[0] + 1),
        )
    at_once, *delayed = (selection * keep > 0 for selection in system.selections)
    delays = tuple(
        replace(x, feedback=tuple(chosen.tolist()))
        for x, chosen in zip(system.delays, delayed, strict=True)
    )
    if not keep.any():
        raise InputError("no state is measured", where="measured", expected="at least one state")
    feedback = tuple(at_once.tolist()) if at_once.any() else None
    return replace(system, delays=delays, feedback=feedback)


def with_integral(
    system: DelaySystem,
    integrated: Sequence[int] | ArrayLike,
    *,
    weights: Sequence[float] | None = None,
    age: float | None = None,
) -> DelaySystem:
    """Return the system with integrals that the controller keeps as further states.

    Parameters
    ----------
    system : Eq. (7) (n states); its feedback says which states are measured, and how late.
    integrated : indices from 0 of k measured states; or S (k, n), rows of their combinations.
    weights : of the k integrals in z [1/s times the unit of z per unit of S x], positive. None:
        0.1/d times the norm of D S', d the greatest feedback delay, or 1 s without a delay; 0.1/d
        where z does not contain the state.
    age : greatest age [s] of an integral where it acts, however it varies; 0: it acts at once.
        None: the greatest of the feedback where that varies, otherwise 0. A sampled controller
        holds its command, so that an integral is as old as a sample.

    Raises
    ------
    InputError : a state that is not measured, or numbers that do not fit.
    """
    n = len(system.A)
    if system.integrals:
        raise InputError("the system has integral action already", where="integral")
    _refuse_masks(system, "integral")
    S = _rows(system, integrated, n)
    k = len(S)
    fed_back = [x for x in system.delays if x.feedback]
    if age is None:
        age = max((x.d for x in fed_back if x.any_age), default=0.0)
    if not (math.isfinite(age) and age >= 0):
        raise InputError("not an age", where="integral.age", expected="seconds >= 0", got=repr(age))
    below = np.zeros((n, k))

    def wider(A: Matrix, selection: Matrix) -> Matrix:
        return np.block([[A, below], [S * selection, np.zeros((k, k))]])

    at_once, *chosen = system.selections
    delays = [
        replace(
            x,
            A=wider(x.A, measured),
            H=np.hstack([x.H, np.zeros((len(x.H), k))]),
            feedback=(*(measured > 0).tolist(), *[False] * k),
        )
        for x, measured in zip(system.delays, chosen, strict=True)
    ]
    mine = [False] * n + [True] * k
    feedback = (*(at_once > 0).tolist(), *[age == 0] * k)
    if age > 0:
        delays.append(Delay(age, np.zeros((n + k, n + k)), feedback=mine, any_age=True))
    matrices: dict[str, Any] = {
        "A": wider(system.A, at_once),
        "B": np.vstack([system.B, np.zeros((k, system.B.shape[1]))]),
        "C": np.vstack([system.C, np.zeros((k, system.C.shape[1]))]),
        "E": np.vstack([system.E, np.zeros((k, system.E.shape[1]))]),
        "H": np.hstack([system.H, np.zeros((len(system.H), k))]),
        "D": np.hstack([system.D, np.zeros((len(system.D), k))]),
    }
    if system.has_performance:
        measured = _weights(system, S, weights)
        rows = np.hstack([np.zeros((k, n)), np.diag(measured)])
        matrices["D"] = np.vstack([matrices["D"], rows])
        matrices["D1"] = np.vstack([system.D1, np.zeros((k, system.D1.shape[1]))])
        matrices["D2"] = np.vstack([system.D2, np.zeros((k, system.D2.shape[1]))])
    return replace(
        system,
        **matrices,
        delays=tuple(delays),
        feedback=feedback if any(feedback) else None,
        integrals=k,
    )


def states_of(numbers: Sequence[float], where: str) -> list[int]:
    """Return the indices from 0 of states that a user counts from 1.

    Raises
    ------
    InputError : not whole numbers from 1 on.
    """
    if not numbers or any(x != int(x) or x < 1 for x in numbers):
        raise InputError(
            "not states",
            where=where,
            expected="whole numbers from 1 on",
            got=", ".join(f"{x:g}" for x in numbers) or "nothing",
        )
    return [int(x) - 1 for x in numbers]


def without_integrals(system: DelaySystem) -> DelaySystem:
    """Return the system as it was before `with_integral`: the plant that a controller meets."""
    k = system.integrals
    if not k:
        return system
    n = len(system.A) - k
    delays = [
        replace(x, A=x.A[:n, :n], H=x.H[:, :n], feedback=tuple((selection[:n] > 0).tolist()))
        for x, selection in zip(system.delays, system.selections[1:], strict=True)
        # a delay of the integrals alone
        if selection[:n].any() or not selection.any()
    ]
    rows = len(system.D) - (k if system.has_performance else 0)
    at_once = tuple((system.selections[0][:n] > 0).tolist())
    return DelaySystem(
        A=system.A[:n, :n],
        B=system.B[:n],
        C=system.C[:n],
        D=system.D[:rows, :n],
        D1=system.D1[:rows],
        D2=system.D2[:rows],
        E=system.E[:n],
        H=system.H[:, :n],
        delays=delays,
        name=system.name,
        feedback=at_once if any(at_once) else None,
        uncertainty_blocks=system.uncertainty_blocks,
    )


def _rows(system: DelaySystem, integrated: Sequence[int] | ArrayLike, n: int) -> Matrix:
    """Return S, checked."""
    given = np.asarray(integrated, dtype=np.float64)
    if given.ndim == 1:
        states = [int(j) for j in given]
        _check_states(states, n, "integral")
        S = np.eye(n)[states]
    else:
        S = given
    if S.ndim != 2 or S.shape[1] != n or not np.isfinite(S).all() or not S.any(axis=1).all():
        raise InputError(
            "not what is to be integrated",
            where="integral",
            expected=f"numbers of states, or rows of {n} finite numbers that are not all zero",
            got=str(np.shape(integrated)),
        )
    if np.linalg.matrix_rank(S) < len(S):
        raise InputError(
            "the integrals depend on each other: one of them could not be controlled",
            where="integral",
            expected="independent rows",
            got=str(S.tolist()),
        )
    lost = np.flatnonzero((S != 0).any(axis=0) & ~system.measured)
    if lost.size:
        raise InputError(
            "a state that is not measured cannot be integrated",
            where="integral",
            expected=_listed(np.flatnonzero(system.measured)),
            got=str(lost[0] + 1),
        )
    if len(S) > system.B.shape[1]:
        raise InputError(
            "more integrals than controls: not all can go to zero",
            where="integral",
            expected=f"at most {system.B.shape[1]}",
            got=str(len(S)),
        )
    return S


def _weights(system: DelaySystem, S: Matrix, weights: Sequence[float] | None) -> Matrix:
    """Return the weight of each integral in z."""
    if weights is None:
        seen = np.linalg.norm(system.D @ S.T, axis=0)
        return np.where(seen > 0, seen, 1.0) * _SHARE / (system.feedback_delay or 1.0)
    numbers = np.array([float(x) for x in weights])
    if len(numbers) == 1:
        numbers = np.full(len(S), numbers[0])
    if numbers.shape != (len(S),) or not (np.isfinite(numbers) & (numbers > 0)).all():
        raise InputError(
            "the weights do not fit the integrals",
            where="integral.weights",
            expected=f"one positive number, or {len(S)} of them",
            got=str(list(weights)),
        )
    return numbers


def _check_states(states: Sequence[int], n: int, where: str) -> None:
    wrong = [j for j in states if not 0 <= j < n]
    if wrong or len(set(states)) < len(states):
        raise InputError(
            "not states of the system",
            where=where,
            expected=f"different numbers from 1 to {n}",
            got=", ".join(str(j + 1) for j in states),
            hint="states are counted from 1, in the order of the rows of A",
        )


def _refuse_masks(system: DelaySystem, where: str) -> None:
    """Refuse a system whose feedback is by entry of K, such as a pair of plant and observer."""
    if system.has_masks:
        raise InputError(
            "the controls of this system do not act on the same states at the same ages",
            where=where,
            expected="feedback by state",
            got="feedback by entry of K",
        )


def _listed(states: Any) -> str:
    return "one of " + ", ".join(str(int(j) + 1) for j in states)


def refuse_structure(system: DelaySystem, what: str, hint: str) -> None:
    """Refuse a system with feedback of single states for `what`.

    Raises
    ------
    InputError : naming it.
    """
    if system.is_structured:
        raise InputError(
            f"{what} needs the whole state, fed back at once or through one delay",
            where=f"{system.name}: feedback" if system.name else "feedback",
            expected="feedback of every state alike",
            got="feedback of single states",
            hint=hint,
        )
