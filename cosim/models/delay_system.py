"""Eq. (7) of the paper, with any number of delays: the linear uncertain time-delay system.

With delays 0 = d_0, d_1, ..., d_N:

    x'(t) = sum_i (A_i + dA_i) x(t-d_i) + B u + C w(t)
    z(t)  = D x(t) + D1 w(t) + D2 u
    [dA_0 ... dA_N] = E F(t) [H_0 ... H_N],   F(t)'F(t) <= I
    u = K x(t-d_f)                                            Eq. (8), f the feedback delay

The paper's system has one delay and immediate feedback (d_f = 0); feedback over a link is a
delay of its own, marked `feedback`. F may be rectangular, as the paper defines it, or block
diagonal: F = diag(F_1, ..., F_b), each block with F_i(t)'F_i(t) <= I. A block of one column of E
and one row of H is a parameter |delta_i(t)| <= 1.

Where not every state is fed back, or not all through one delay, u = K sum_i S_i x(t-d_i) with
diagonal selections S_i of zeros and ones, no state selected twice. A state that none selects is
not measured: its column of K is zero. In general u = sum_i (K o M_i) x(t-d_i), with masks M_i
(m, n) of zeros and ones on the entries of K, no entry in two: so the rows of K may act at different
ages.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError, Seconds, html_table, matrix_text, seconds
from cosim.models.state_space import plant_from
from cosim.models.values import Value, read_only

Matrix = NDArray[np.float64]
"""A matrix of doubles."""

Feedback = bool | tuple[bool, ...] | tuple[tuple[bool, ...], ...]
"""What acts through a delay: all of K, the columns of some states, or entries of K row by row."""


def read_only_matrix(name: str, value: ArrayLike, rows: int | None, columns: int | None) -> Matrix:
    """Return a read-only float copy of `value`, checked against the shape (None: any)."""
    expected = f"shape ({'any' if rows is None else rows}, {'any' if columns is None else columns})"
    try:
        matrix = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: not a matrix of numbers; expected {expected}") from error
    wrong_rows = rows is not None and matrix.shape[:1] != (rows,)
    wrong_columns = columns is not None and matrix.shape[1:] != (columns,)
    if matrix.ndim != 2 or wrong_rows or wrong_columns:
        raise InputError(f"{name}: wrong shape; expected {expected}, got {matrix.shape}")
    if not np.isfinite(matrix).all():
        raise InputError(f"{name}: expected finite numbers, got {matrix[~np.isfinite(matrix)][0]}")
    return read_only(matrix)


def _mask(feedback: Feedback, n: int) -> Matrix:
    """Return ones where K acts: (n,) by state, the diagonal of S, or (m, n) by entry."""
    mask = np.full(n, feedback, dtype=np.float64) if isinstance(feedback, bool) else None
    return np.array(feedback, dtype=np.float64) if mask is None else mask


def _selection(name: str, value: Any, n: int) -> Feedback:
    """Return True for all states, False for none, otherwise one truth value per state.

    Where rows of K differ: these truth values for each row.
    """
    if isinstance(value, bool | np.bool_):
        return bool(value)
    chosen = tuple(value)
    if chosen and all(isinstance(x, list | tuple | np.ndarray) for x in chosen):
        rows = tuple(_by_state(name, row, n) for row in chosen)
        if len(set(rows)) > 1:
            return rows
        chosen = rows[0]
    chosen = _by_state(name, chosen, n)
    return any(chosen) if any(chosen) == all(chosen) else chosen


def _by_state(name: str, value: Any, n: int) -> tuple[bool, ...]:
    """Return n truth values, checked."""
    chosen = tuple(value)
    if len(chosen) != n or not all(isinstance(x, bool | np.bool_) for x in chosen):
        raise InputError(
            f"{name}: expected a truth value, or {n} of them, or {n} in each row of K, "
            f"got {value!r}"
        )
    return tuple(map(bool, chosen))


def _size(name: str, sizes: dict[str, int]) -> int:
    """Return the dimension that all given matrices share; 0 if none is given."""
    counts = set(sizes.values())
    if len(counts) > 1:
        got = ", ".join(f"{matrix} has {size}" for matrix, size in sizes.items())
        raise InputError(f"{name}: matrices disagree; expected one number, got {got}")
    return counts.pop() if counts else 0


def _block_sizes(value: Any, s: int, r: int) -> tuple[tuple[int, int], ...] | None:
    """Return the columns of E and rows of H of every block; None where there is one at most."""
    if value is None:
        return None
    name = "uncertainty_blocks"
    try:
        blocks = tuple((operator.index(p), operator.index(q)) for p, q in value)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{name}: expected a pair of numbers (columns of E, rows of H) per block, got {value!r}"
        ) from error
    if any(min(block) < 1 for block in blocks):
        raise InputError(f"{name}: expected at least one column and one row each, got {blocks}")
    sums = sum(p for p, _ in blocks), sum(q for _, q in blocks)
    if sums != (s, r):
        raise InputError(
            f"{name}: expected blocks of {s} columns of E and {r} rows of H in all, "
            f"got {sums[0]} and {sums[1]}"
        )
    return blocks if len(blocks) > 1 else None


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Delay(Value):
    """One delayed term (A_i + dA_i) x(t-d_i) of a `DelaySystem`.

        >>> from cosim import Delay, link
        >>> damping = Delay("500 ms", [[0, 0], [0, -0.1]], any_age=True)
        >>> damping.d, damping.feedback
        (0.5, False)
        >>> Delay(0.8, feedback=True, any_age=True) == link(0.8)
        True

    Parameters
    ----------
    d : the delay [s], or a text with a unit; finite and not negative.
    A : (n, n) the matrix of x(t-d); None: zero, for example if only the control acts through the
        delay.
    H : (r, n) the right factor of the uncertainty for this delay; None: no uncertainty.
    feedback : the control acts through this delay, u = K x(t-d). One truth value per state if only
        some are fed back through it; a row of them per control if entries of K act through
        different delays.
    any_age : design for every time-varying delay tau(t) <= d, however fast it varies
        (Q = 0 in the functional), instead of the constant delay d. True wherever the age varies: a
        proof for any age up to d also holds for the kinds of age below.
    least_age : the age is never less than this [s], least_age <= tau(t) <= d; 0 <= least_age < d.
    rate : the age is Lipschitz continuous with |tau'| <= rate; None: it may jump.
    sampled : the age is least_age when a message comes into use, and grows at rate one, to at most
        d, until the next one does: x(t-tau) is x(s_k) from s_k + least_age on, with s_{k+1} - s_k
        <= d - least_age, the instants s_k arbitrary otherwise.

    Raises
    ------
    InputError : names the argument, what was expected and what was got.
    """

    d: float
    A: Matrix
    H: Matrix
    feedback: Feedback
    any_age: bool
    least_age: float
    rate: float | None
    sampled: bool

    def __init__(
        self,
        d: Seconds,
        A: ArrayLike | None = None,
        H: ArrayLike | None = None,
        feedback: bool | Sequence[bool] | Sequence[Sequence[bool]] = False,  # noqa: FBT001, FBT002 - fields of a record
        any_age: bool = False,  # noqa: FBT001, FBT002
        *,
        least_age: Seconds = 0.0,
        rate: float | None = None,
        sampled: bool = False,
    ) -> None:
        d, least_age = seconds(d, "delay d"), seconds(least_age, "least_age")
        if not (math.isfinite(d) and d >= 0):
            raise InputError(f"delay d: expected a finite number of seconds >= 0, got {d}")
        varies = any_age or sampled or rate is not None
        if not 0 <= least_age <= d or (least_age == d and d > 0):
            raise InputError(
                f"least_age: expected at least 0 and less than d = {d}, got {least_age}"
            )
        if least_age > 0 and not varies:
            raise InputError(
                "least_age: expected an age that varies (any_age, rate or sampled), "
                "got a constant delay"
            )
        if rate is not None and not (math.isfinite(rate) and rate >= 0):
            raise InputError(f"rate: expected a finite bound of |tau'|, >= 0, got {rate}")
        if rate is not None and sampled:
            raise InputError("rate: expected none with sampled (the age jumps), got both")
        if A is None:  # of no states yet: the system says how many
            A = np.zeros((n := _states_of(H, feedback), n))
        n = read_only_matrix("A of a delay", A, None, None).shape[0]
        object.__setattr__(self, "d", float(d))
        object.__setattr__(self, "A", read_only_matrix("A of a delay", A, n, n))
        right = np.zeros((0, n)) if H is None else H
        object.__setattr__(self, "H", read_only_matrix("H of a delay", right, None, n))
        object.__setattr__(self, "feedback", _selection("feedback of a delay", feedback, n))
        object.__setattr__(self, "any_age", bool(varies))
        object.__setattr__(self, "least_age", float(least_age))
        object.__setattr__(self, "rate", None if rate is None else float(rate))
        object.__setattr__(self, "sampled", bool(sampled))

    def __repr__(self) -> str:
        states = f", of {len(self.A)} states" if len(self.A) else ""
        return f"<Delay: {self.description}{states}>"

    def of_states(self, n: int) -> Delay:
        """Return the delay for n states; a delay without a matrix gets a zero matrix."""
        return (
            self if len(self.A) or n == 0 else replace(self, A=np.zeros((n, n)), H=np.zeros((0, n)))
        )

    def _repr_html_(self) -> str:
        """Return what is known of it and its matrix, as notebooks show it."""
        rows = {"A": matrix_text(self.A)} | ({"H": matrix_text(self.H)} if self.H.size else {})
        return html_table(repr(self), rows)

    @property
    def description(self) -> str:
        """What is known of the delay, in a few words: "0.3 s, any age, feedback"."""
        words = [f"{self.d:.6g} s"]
        if self.sampled:
            words.append("sampled")
        elif self.rate is not None:
            words.append(f"rate up to {self.rate:g}")
        elif self.any_age:
            words.append("any age")
        if self.least_age:
            words.append(f"at least {self.least_age:g} s")
        if self.feedback:
            chosen = _mask(self.feedback, len(self.A))
            states = ", ".join(str(i) for i, row in enumerate(chosen.T, 1) if np.any(row))
            of_whole_state = isinstance(self.feedback, bool)
            words.append("feedback" if of_whole_state else f"feedback of x[{states}]")
            if chosen.ndim == 2:
                rows = ", ".join(str(i) for i, row in enumerate(chosen, 1) if row.any())
                words[-1] += f" to u[{rows}]"
        return ", ".join(words)

    @property
    def ages_are_known(self) -> bool:
        """Whether more is known of an age that varies than its bound d."""
        return self.d > 0 and (self.least_age > 0 or self.rate is not None or self.sampled)

    @property
    def constant_age(self) -> float:
        """The constant [s] in its place in the nominal loop: d, or the mean of a sampled age.

        A sampled age cannot stay at d: the loop may be stable although it is not at a constant d.
        """
        return (self.least_age + self.d) / 2 if self.sampled else self.d


def _states_of(H: ArrayLike | None, feedback: Any) -> int:
    """Return the number of states that a delay without a matrix names; 0 where it names none."""
    if H is not None:
        return int(np.shape(H)[-1])
    return 0 if isinstance(feedback, bool) else int(np.shape(feedback)[-1])


def link(d: Seconds, **ages: Any) -> Delay:
    """Return the delay of a link: the control acts through it, at any age up to d [s].

        >>> from cosim import DelaySystem, link
        >>> up = link("800 ms")
        >>> up.d, up.feedback, up.any_age
        (0.8, True, True)
        >>> DelaySystem(A=[[0]], B=[[1]], delays=[link(2.0, any_age=False)])
        <DelaySystem: 1 state, 1 control, delay 2 s, feedback>

    ages : as of `Delay`: `least_age`, `rate`, `sampled`; `any_age=False` for a constant delay.
    """
    return Delay(d, feedback=True, **{"any_age": True, **ages})


def _delays(delays: Sequence[Any], n: int) -> list[Delay]:
    """Return the delays of a system of n states."""
    for i, delay in enumerate(delays, 1):
        if not isinstance(delay, Delay):
            raise InputError(
                f"delay {i}: not a Delay",
                expected=f"Delay({delay!r}, A), or link({delay!r}) of the control",
                got=type(delay).__name__,
            )
    return [delay.of_states(n) for delay in delays]


def _fed_back_at_once(
    feedback: Sequence[Any] | None, delays: Sequence[Delay], m: int, n: int
) -> tuple[bool, ...] | tuple[tuple[bool, ...], ...] | None:
    """Return what is fed back at once, checked beside the delays; None where that is usual."""
    of_whole_state = [i for i, delay in enumerate(delays, 1) if delay.feedback is True]
    if len(of_whole_state) > 1:
        raise InputError(f"feedback: expected at most one delay, got delays {of_whole_state}")
    if feedback is None:
        at_once: Feedback = not any(x.feedback for x in delays)
    else:
        at_once = _selection("feedback", list(feedback), n)
    masks = [_mask(x, n) for x in (at_once, *(x.feedback for x in delays))]
    for mask in masks:
        if mask.ndim == 2 and len(mask) != m:
            raise InputError(f"feedback: expected one row per control, {m}, got {len(mask)}")
    used = np.asarray(sum(masks[1:], masks[0]))
    if used.max() > 1:
        by_state = used if used.ndim == 1 else used.max(axis=0)
        raise InputError(
            "feedback: expected every state fed back once at most, got state "
            f"{1 + int(by_state.argmax())} fed back {int(used.max())} times"
        )
    if not used.any():
        raise InputError("feedback: expected at least one state that is fed back, got none")
    usual = isinstance(at_once, bool) and at_once != any(x.feedback for x in delays)
    if usual:
        return None
    return (at_once,) * n if isinstance(at_once, bool) else at_once


@dataclass(frozen=True, init=False, eq=False, repr=False)
class DelaySystem(Value):
    """Eq. (7) with several delays; matrices are read-only float arrays.

        >>> from cosim import DelaySystem, link
        >>> masses = DelaySystem(
        ...     A=[[0, 1], [-1, -0.5]], B=[[0], [1]], C=[[0], [1]], D=[[1, 0], [0, 0]],
        ...     D2=[[0], [1]], delays=[link(0.6)], name="two masses",
        ... )
        >>> masses.A.shape, masses.delays[0].d, masses.with_(delays=[link("1 s")]).delays[0].d
        ((2, 2), 0.6, 1.0)

    An absent matrix is zero if its dimension is known from another one, otherwise that
    dimension is 0. Without a disturbance (no C, no D1) or without a performance output (no D, no
    D1, no D2) there is no gain, only stability; without E and H there is no uncertainty. Without
    B there is no control: such a system can be analysed, but no gain can be designed for it, and it
    has no D2.

    Parameters
    ----------
    A : (n, n).
    B : (n, m) input matrix.
    C : (n, q) disturbance matrix.
    D, D1, D2 : (p, n), (p, q), (p, m) of the performance output z.
    E : (n, s) left factor of the uncertainty; F(t) is (s, r).
    H : (r, n) right factor for x(t); each delay has its own.
    delays : the delayed terms. At most one is the feedback, or several with a truth value per
        state, or per entry of K; no state or entry is fed back twice.
    name : for messages and files.
    feedback : the states that are fed back at once, one truth value each, or a row of them per
        control. None: all of them if no delay is the feedback, otherwise none.
    integrals : the number of states, at the end, that the controller itself keeps as integrals of
        its measurements. It matters for building the controller, not for a proof.
    uncertainty_blocks : (columns of E, rows of H) of every block of a block-diagonal F, in order;
        (1, 1) is a parameter. None: F is one full block.

    Raises
    ------
    ValueError : names the matrix, what was expected and what was got.
    """

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    D1: Matrix
    D2: Matrix
    E: Matrix
    H: Matrix
    delays: tuple[Delay, ...]
    name: str
    feedback: tuple[bool, ...] | tuple[tuple[bool, ...], ...] | None
    integrals: int
    uncertainty_blocks: tuple[tuple[int, int], ...] | None

    def __init__(
        self,
        A: ArrayLike,
        B: ArrayLike | None = None,
        C: ArrayLike | None = None,
        D: ArrayLike | None = None,
        D1: ArrayLike | None = None,
        D2: ArrayLike | None = None,
        E: ArrayLike | None = None,
        H: ArrayLike | None = None,
        delays: Sequence[Delay] = (),
        name: str = "",
        feedback: Sequence[bool] | Sequence[Sequence[bool]] | None = None,
        integrals: int = 0,
        uncertainty_blocks: Sequence[Sequence[int]] | None = None,
    ) -> None:
        n = read_only_matrix("A", A, None, None).shape[0]
        if n == 0:
            raise InputError("A: expected at least one state, got shape (0, 0)")
        values = {"A": A, "B": B, "C": C, "D": D, "D1": D1, "D2": D2, "E": E, "H": H}
        heights, widths = {"A": n, "B": n, "C": n, "E": n}, {"A": n, "D": n, "H": n}
        given = {
            key: read_only_matrix(key, value, heights.get(key), widths.get(key))
            for key, value in values.items()
            if value is not None
        }

        def size(what: str, axis: int, *names: str) -> int:
            return _size(what, {k: given[k].shape[axis] for k in names if k in given})

        m = size("inputs (columns of B, D2)", 1, "B", "D2")
        if m and "B" not in given:
            raise InputError(
                f"B: expected shape {(n, m)} beside D2, which weighs u; got no B",
                hint="give B, a row per state, or leave D2 out",
            )
        q = size("disturbances (columns of C, D1)", 1, "C", "D1")
        p = size("performance outputs (rows of D, D1, D2)", 0, "D", "D1", "D2")
        delays = _delays(delays, n)
        for i, delay in enumerate(delays, 1):
            if delay.A.shape != (n, n):
                raise InputError(f"A of delay {i}: expected {(n, n)}, got {delay.A.shape}")
        rows = {f"H of delay {i}": x.H.shape[0] for i, x in enumerate(delays, 1) if x.H.size}
        if "H" in given:
            rows["H"] = given["H"].shape[0]
        r = _size("rows of H", rows)
        s = given["E"].shape[1] if "E" in given else 0
        if (r == 0) != (s == 0):
            got = "H without E" if s == 0 else "E without H"
            raise InputError(
                f"uncertainty E F [H ...]: expected both factors, got {got}",
                hint="E with as many rows as states, H with as many columns; or neither of them",
            )
        shapes = ((n, n), (n, m), (n, q), (p, n), (p, q), (p, m), (n, s), (r, n))
        for key, shape in zip(values, shapes, strict=True):
            matrix = given[key] if key in given else read_only_matrix(key, np.zeros(shape), *shape)
            object.__setattr__(self, key, matrix)
        complete = tuple(x if x.H.size else replace(x, H=np.zeros((r, n))) for x in delays)
        object.__setattr__(self, "delays", complete)
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "feedback", _fed_back_at_once(feedback, delays, m, n))
        object.__setattr__(self, "integrals", integrals)
        sizes = _block_sizes(uncertainty_blocks, s, r)
        object.__setattr__(self, "uncertainty_blocks", sizes)
        first = n - integrals
        if not 0 < first <= n or self.B[first:].any() or self.C[first:].any():
            raise InputError(
                f"integrals: expected fewer than {n} states, the last, without B and C, "
                f"got {integrals}"
            )

    def with_(self, **changes: Any) -> DelaySystem:
        """Return the system with other values of these parameters.

        [design(system.with_(delays=[link(age)])).gamma for age in (0.5, 1.0, 2.0)]
        """
        known = [field.name for field in fields(self)]
        for name in changes:
            if name not in known:
                raise InputError.unknown("parameter", name, known, where="with_")
        return replace(self, **changes)

    @classmethod
    def from_state_space(
        cls,
        plant: Any,
        *,
        ncon: int,
        delays: Sequence[Delay] = (),
        E: ArrayLike | None = None,
        H: ArrayLike | None = None,
        name: str = "",
        uncertainty_blocks: Sequence[Sequence[int]] | None = None,
    ) -> DelaySystem:
        """Make a system of a state-space model, such as one of `control.ss`.

        Parameters
        ----------
        plant : in continuous time; its inputs are w and then, the last `ncon`, u, as in
            `control.hinfsyn`; its outputs are z. Every state is fed back.
        ncon : number of controls.
        delays, E, H, name, uncertainty_blocks : as of `DelaySystem`; a delay with `feedback`
            makes u = K x(t-d).

        Raises
        ------
        ValueError : not such a model, or matrices that do not fit together.
        """
        matrices = plant_from(plant, ncon)
        return cls(*matrices, E, H, delays, name, uncertainty_blocks=uncertainty_blocks)

    def __repr__(self) -> str:
        (n, m), q, p = self.B.shape, self.C.shape[1], self.D.shape[0]
        counts = [(n, "state"), (m, "control"), (q, "disturbance"), (p, "output")]
        words = [f"{k} {what}{'' if k == 1 else 's'}" for k, what in counts if k]
        listed = "; ".join(delay.description for delay in self.delays)
        words.append(
            f"{'delays' if len(self.delays) > 1 else 'delay'} {listed}" if listed else "no delay"
        )
        if self.E.size:
            words.append("uncertain")
        name = f" {self.name!r}" if self.name else ""
        return f"<DelaySystem{name}: {', '.join(words)}>"

    def _repr_html_(self) -> str:
        """Return sizes and matrices, as notebooks show them."""
        names = ("A", "B", "C", "D", "D1", "D2", "E", "H")
        rows = {name: matrix_text(M) for name in names if (M := getattr(self, name)).size}
        rows |= {
            f"delay {i}": f"{delay.description}: A = {matrix_text(delay.A)}"
            for i, delay in enumerate(self.delays, 1)
        }
        return html_table(repr(self), rows)

    @property
    def immediate_feedback(self) -> bool:
        """Whether u = K x(t): no delay is the feedback."""
        return not any(delay.feedback for delay in self.delays)

    @property
    def selections(self) -> tuple[Matrix, ...]:
        """The diagonals (n,) of S_i: the states fed back at once, then through each delay.

        Where entries of K act through different delays: the masks M_i (m, n), all of them. Either
        way K S_i is K * S_i in numpy.
        """
        m, n = self.B.shape[1], len(self.A)
        at_once = self.immediate_feedback if self.feedback is None else self.feedback
        masks = [_mask(x, n) for x in (at_once, *(delay.feedback for delay in self.delays))]
        if all(mask.ndim == 1 for mask in masks):
            return tuple(masks)
        return tuple(np.broadcast_to(mask, (m, n)) for mask in masks)

    @property
    def measured(self) -> NDArray[np.bool_]:
        """Whether each state (n,) is fed back; K has a column of zeros where it is not."""
        acting = np.asarray(np.sum(self.selections, axis=0) > 0)
        return np.asarray(acting if acting.ndim == 1 else acting.any(axis=0))

    @property
    def free(self) -> NDArray[np.bool_]:
        """Whether each entry (m, n) of K may differ from zero."""
        acting = np.sum(self.selections, axis=0) > 0
        return np.array(np.broadcast_to(acting, self.B.T.shape))

    @property
    def has_masks(self) -> bool:
        """Whether entries of one column of K act through different delays."""
        return any(selection.ndim == 2 for selection in self.selections)

    @property
    def is_structured(self) -> bool:
        """Whether a state is not fed back, or states are fed back through different delays."""
        return not any(selection.all() for selection in self.selections)

    @property
    def blocks(self) -> tuple[tuple[slice, slice], ...]:
        """The columns of E and the rows of H of every block of F; empty without uncertainty."""
        s, r = self.E.shape[1], self.H.shape[0]
        pairs, column, row = [], 0, 0
        for p, q in self.uncertainty_blocks or (((s, r),) if s else ()):
            pairs.append((slice(column, column + p), slice(row, row + q)))
            column, row = column + p, row + q
        return tuple(pairs)

    @property
    def has_performance(self) -> bool:
        """Whether there is an H-infinity gain from w to z."""
        return bool(self.C.size and self.D.size)

    @property
    def feedback_delay(self) -> float:
        """The delay d_f [s] of u = K x(t-d_f), the greatest where there are several."""
        return max((delay.d for delay in self.delays if delay.feedback), default=0.0)
