"""The forms of `ages_lmi` for one part of a loop: Phi at every corner, and what must be positive.

The equations are those of `cosim.hinf.certificate.ages_proof`, here with selection matrices, in
the loop's own units: unknowns over a length l are counted in units of max(1, l). The terms of a
delay are about y = C x of that delay, in units of its own.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.hinf.certificate import AgeFunctional, is_symmetric_unknown
from cosim.hinf.lmi.analysis_lmi import couplings
from cosim.hinf.lmi.conic import Constraint
from cosim.hinf.lmi.svec import Array, product, products, svec

_PI_LOWER = 333 / 106

Corner = tuple[tuple[float, float], ...]
"""An age, in own units, and its slope per positive delay."""


@dataclass(frozen=True)
class LateAge:
    """A positive delay in the loop's own time.

    index : in `system.delays`.
    d, least : its bounds.
    rate : bound of its slope.
    """

    index: int
    functional: AgeFunctional
    d: float
    least: float
    rate: float

    @property
    def part(self) -> float:
        """The length of the constant part."""
        return self.d if self.functional == "constant" else self.least

    @property
    def rest(self) -> float:
        """The length over which it varies."""
        return self.d - self.least

    @property
    def s(self) -> float:
        """The unit of lengths in the terms of the constant part."""
        return max(1.0, self.part)

    @property
    def u(self) -> float:
        """The unit of lengths in the other terms."""
        return max(1.0, self.rest)


def is_symmetric_in_form(name: str) -> bool:
    """Whether an unknown of a form is a symmetric matrix: "part P", "part delay R", "gain X"."""
    return not name.startswith("gain") and is_symmetric_unknown(name.rsplit(maxsplit=1)[-1])


def count_of(name: str, shape: tuple[int, int]) -> int:
    """Return how many numbers an unknown of a form consists of."""
    rows, columns = shape
    return rows * (rows + 1) // 2 if is_symmetric_in_form(name) else rows * columns


class Form:
    """A symmetric matrix that is linear in named unknowns."""

    def __init__(self, size: int) -> None:
        self.size, self.constant = size, np.zeros((size, size))
        self.supplied: Array | None = None  # w'w, beside gamma
        self._terms: list[tuple[str, Array, Array, float]] = []
        self._multiples: list[tuple[str, Array]] = []

    def square(self, name: str, left: Array, weight: float = 1.0) -> None:
        """Add weight left'V left, V symmetric."""
        self._terms.append((name, left, left, 0.5 * weight))

    def multiple(self, name: str, matrix: Array) -> None:
        """Add a scalar unknown times a symmetric matrix."""
        self._multiples.append((name, matrix))

    def twice(self, name: str, left: Array, right: Array, weight: float = 1.0) -> None:
        """Add weight (left'V right + its transpose)."""
        self._terms.append((name, left, right, weight))

    def constraint(self, places: dict[str, slice], width: int) -> Constraint:
        """Return the matrix as M(y) >= 0."""
        columns = np.zeros((self.size * (self.size + 1) // 2, width))
        for name, matrix in self._multiples:
            columns[:, places[name]] += svec(matrix)[:, None]
        for name, left, right, weight in self._terms:
            if not len(left):
                continue  # a part of w alone
            own = product if is_symmetric_in_form(name) else products
            columns[:, places[name]] += own(left, right, weight=weight)
        return Constraint(self.size, svec(self.constant), columns)


class PartOfLoop:
    """The forms of one part.

    Parameters
    ----------
    number : of the part; its unknowns are "number P" and "number delay name".
    order : N.
    late : its positive delays.
    A, H, D : the loop's matrices for x(t) and for every delay of the system; of x where it is
        zero, otherwise of y.
    S : C of every delay of the system.
    C, E, D1 : the loop's, of the disturbances and of the columns of E that belong to the part.
    rows : sizes of the rows of -Phi, by name.
    blocks : sizes of the blocks of the vector of V, by name.
    channels : the unknown, the columns of E that belong to the part, and the rows of H, of every
        block of the uncertainty.
    """

    def __init__(
        self,
        number: int,
        order: int,
        late: list[LateAge],
        matrices: dict[str, list[Array]],
        rows: dict[str, int],
        blocks: dict[str, int],
        channels: dict[str, tuple[NDArray[np.bool_], slice]] | None = None,
    ) -> None:
        self._number, self._order, self._late = number, order, late
        self._matrices, self._rows, self._blocks = matrices, rows, blocks
        self._channels = channels or {}
        self._S = [matrices["S"][x.index] for x in late]
        self._base = sum(rows.values())

    def _name(self, j: int, name: str) -> str:
        return f"{self._number} {j} {name}"

    def _selections(self, sizes: dict[str, int]) -> dict[str, Array]:
        total, start, at = sum(sizes.values()), 0, {}
        for name, size in sizes.items():
            at[name] = np.eye(size, total, start)
            start += size
        return at

    def corners(self, *, down_to_zero: bool = False) -> Iterator[Corner]:
        """Yield the corners: an age and its slope per delay."""
        ends = []
        for x in self._late:
            if x.functional == "rate":
                ages = (x.least, x.d) if self._order else (x.least,)
                ends.append([(age, slope) for age in ages for slope in sorted({-x.rate, x.rate})])
            elif x.functional == "looped" or (x.functional == "interval" and self._order):
                ends.append([(x.least, 0.0), (x.d, 0.0)])
            elif x.functional == "constant" and self._order and down_to_zero:
                ends.append([(x.d, 0.0), (0.0, 0.0)])
            else:
                ends.append([(x.d, 0.0)])
        yield from itertools.product(*ends)

    def forms(self, gamma: float, *, down_to_zero: bool) -> Iterator[Form]:
        """Yield Phi at every corner."""
        for corner in self.corners(down_to_zero=down_to_zero):
            yield self._phi(corner, gamma)

    def rows_at(self, corner: Corner) -> dict[str, Array]:
        """Return the selections of all rows of Phi at a corner, with those that it adds."""
        sizes = dict(self._rows)
        for j, (x, (age, _)) in enumerate(zip(self._late, corner, strict=True)):
            if x.functional == "looped" and age == x.d:
                sizes[f"v{j}"] = len(self._S[j]) * (2 if x.least > 0 else 1)
        return self._selections(sizes)

    def _phi(self, corner: Corner, gamma: float) -> Form:
        given, at = self._matrices, self.rows_at(corner)
        form = Form(at["x"].shape[1])
        on = [at["x"], *(S @ at["x"] for S in given["S"])]
        for j, x in enumerate(self._late):
            on[1 + x.index] = at[f"x{j}"]
        f = np.asarray(sum(A @ x for A, x in zip(given["A"], on, strict=True)))
        if "w" in at:
            f = f + given["C"][0] @ at["w"]
        if "p" in at:
            f = f + given["E"][0] @ at["p"]
        self.add_functional(form, at, f, corner)
        if "p" in at:
            q = np.asarray(sum(H @ x for H, x in zip(given["H"], on, strict=True)))
            for name, (columns, rows) in self._channels.items():
                own, own_q = at["p"][columns], q[rows]
                form.multiple(name, own_q.T @ own_q - own.T @ own)
        if "w" in at:
            z = np.asarray(sum(D @ x for D, x in zip(given["D"], on, strict=True)))
            z = z + given["D1"][0] @ at["w"]
            form.constant, form.supplied = z.T @ z / gamma, at["w"].T @ at["w"]
        return form

    def add_functional(self, form: Form, at: dict[str, Array], f: Array, corner: Corner) -> None:
        """Add V' at a corner, x' = f; `at` selects the rows."""
        y, rate = [at["x"]], [f]
        for j, (x, (age, slope)) in enumerate(zip(self._late, corner, strict=True)):
            own = self._S[j] @ f
            start = self._S[j] @ at["x"]
            if x.functional == "constant":
                more = self._constant_part(form, at, j, own, at[f"x{j}"], age)
            elif x.least > 0:
                start = at[f"h{j}"]
                more = self._constant_part(form, at, j, own, start, x.part)
            else:
                more = ([], [])
            y, rate = y + more[0], rate + more[1]
            if x.functional in {"interval", "rate"}:
                more = self._between(form, at, j, own, start, age, slope)
                y, rate = y + more[0], rate + more[1]
            elif x.functional == "wirtinger":
                form.square(self._name(j, "W"), own, (x.rest / x.u) ** 2)
                form.square(self._name(j, "W"), start - at[f"x{j}"], -((_PI_LOWER / 2 / x.u) ** 2))
            elif x.functional == "looped":
                if x.least > 0:
                    y, rate = [*y, start], [*rate, at[f"r{j}"]]
                self._looped(form, at, j, own, age)
        form.twice(f"{self._number} P", np.concatenate(y), np.concatenate(rate))

    def _constant_part(
        self, form: Form, at: dict[str, Array], j: int, f: Array, end: Array, length: float
    ) -> tuple[list[Array], list[Array]]:
        """Add the terms of Q and R; return the blocks of y and their derivatives."""
        x, order, now = self._late[j], self._order, self._S[j] @ at["x"]
        form.square(self._name(j, "Q"), now)
        form.square(self._name(j, "Q"), end, -1.0)
        form.square(self._name(j, "R"), f, (length / x.s) ** 2)
        v = []
        for k in range(order + 1):
            means = (c * at[f"W{j},{i}"] for i, c in enumerate(couplings(k)))
            v.append(now - (-1) ** k * end - sum(means, np.zeros_like(end)))
            form.square(self._name(j, "R"), v[k], -(2 * k + 1) / x.s**2)
        blocks = [length / x.s * at[f"W{j},{k}"] for k in range(order)]
        return blocks, [v[k] / x.s for k in range(order)]

    def _between(
        self,
        form: Form,
        at: dict[str, Array],
        j: int,
        f: Array,
        start: Array,
        age: float,
        slope: float,
    ) -> tuple[list[Array], list[Array]]:
        """Add the terms of an age between two bounds; return its blocks of y and their rates."""
        x, now, end = self._late[j], at[f"x{j}"], at[f"d{j}"]
        young, old = [start - now], [now - end]
        if self._order:
            young.append(start + now - 2 * at[f"a{j}"])
            old.append(now + end - 2 * at[f"b{j}"])
        form.square(self._name(j, "Z"), f, (x.rest / x.u) ** 2)
        for k, pair in enumerate(zip(young, old, strict=True)):
            for change in pair:
                form.square(self._name(j, "Z"), change, -(2 * k + 1) / x.u**2)
        form.twice(self._name(j, "M"), np.concatenate(young), np.concatenate(old), -1 / x.u**2)
        if x.functional == "interval":
            form.square(self._name(j, "S"), start)
            form.square(self._name(j, "S"), end, -1.0)
        else:
            form.square(self._name(j, "S_1"), start)
            form.square(self._name(j, "S_1"), now, slope - 1)
            form.square(self._name(j, "S_2"), now, 1 - slope)
            form.square(self._name(j, "S_2"), end, -1.0)
        if not self._order:
            return [], []
        first = (age - x.least) / x.u * at[f"a{j}"]
        second = (x.d - age) / x.u * at[f"b{j}"]
        if x.functional == "interval":
            return [first + second], [(start - end) / x.u]
        rates = [(start - (1 - slope) * now) / x.u, ((1 - slope) * now - end) / x.u]
        return [first, second], rates

    def _looped(self, form: Form, at: dict[str, Array], j: int, f: Array, age: float) -> None:
        x, now = self._late[j], self._S[j] @ at["x"]
        z, first, rate = now - at[f"x{j}"], at[f"x{j}"], f
        if x.least > 0:
            z = np.concatenate([now - at[f"t{j}"], at[f"h{j}"] - at[f"x{j}"]])
            first = np.concatenate([at[f"t{j}"], at[f"x{j}"]])
            rate = np.concatenate([f, at[f"r{j}"]])
            form.square(self._name(j, "N"), f)
            form.square(self._name(j, "N"), at[f"r{j}"], -1.0)
        rows = np.eye(self._base, form.size)
        form.square(self._name(j, "X_a"), z, -1 / x.u)
        form.twice(self._name(j, "X_b"), z, first, -1 / x.u)
        form.twice(self._name(j, "Y"), rows, z, -1 / x.u)
        share = x.rest / x.u
        if age == x.d:
            form.twice(self._name(j, "Y"), rows, at[f"v{j}"], share)
            form.square(self._name(j, "U"), at[f"v{j}"], -share)
        else:
            form.square(self._name(j, "U"), rate, share)
            form.twice(self._name(j, "X_a"), rate, z, share)
            form.twice(self._name(j, "X_b"), rate, first, share)

    def positive(self) -> list[Form]:
        """Return the other matrices that must be positive."""
        found: list[Form] = []
        if not self._rows["x"]:
            return []
        for j, x in enumerate(self._late):
            n = len(self._S[j])
            if not n:
                continue
            names = {
                "constant": ["Q", "R"],
                "interval": ["S"],
                "rate": ["S_1", "S_2"],
                "wirtinger": ["W"],
                "looped": ["N"] if x.least > 0 else [],
            }[x.functional]
            if x.functional != "constant" and x.least > 0:
                names = ["Q", "R", *names]
            for name in names:
                form = Form(n)
                form.square(self._name(j, name), np.eye(n))
                found.append(form)
            if x.functional in {"interval", "rate"}:
                count = 2 if self._order else 1
                form = Form(2 * count * n)
                for i in range(2 * count):
                    part = np.eye(n, form.size, i * n)
                    form.square(self._name(j, "Z"), part, 2 * (i % count) + 1)
                left = np.eye(count * n, form.size)
                form.twice(self._name(j, "M"), left, np.eye(count * n, form.size, count * n))
                found.append(form)
            if x.functional == "looped":
                form = Form(n * (2 if x.least > 0 else 1))
                form.square(self._name(j, "U"), np.eye(form.size))
                found.append(form)
        looped = [j for j, x in enumerate(self._late) if x.functional == "looped"]
        for count in range(len(looped) + 1):
            found += [
                self._functional(sampled) for sampled in itertools.combinations(looped, count)
            ]
        return found

    def _functional(self, sampled: tuple[int, ...]) -> Form:
        """P with what the other terms add, at the start of a hold of the delays `sampled`."""
        sizes = dict(self._blocks)
        for j in sampled:
            names = [f"t{j}"] if self._late[j].least > 0 else []
            sizes |= dict.fromkeys([*names, f"x{j}"], len(self._S[j]))
        at = self._selections(sizes)
        form = Form(sum(sizes.values()))
        form.square(f"{self._number} P", np.eye(sum(self._blocks.values()), form.size))
        for j, x in enumerate(self._late):
            for k in range(self._order):
                if f"W{j},{k}" in at:
                    weight = (2 * k + 1) * x.s**2 / x.part
                    form.square(self._name(j, "Q"), at[f"W{j},{k}"], weight)
            for name, S in ((f"ab{j}", "S"), (f"a{j}", "S_1"), (f"b{j}", "S_2")):
                if name in at:
                    form.square(self._name(j, S), at[name], x.u**2 / x.rest)
            if j not in sampled:
                continue
            now = self._S[j] @ at["x"]
            z, start = now - at[f"x{j}"], at[f"x{j}"]
            if x.least > 0:
                z = np.concatenate([now - at[f"t{j}"], at[f"h{j}"] - at[f"x{j}"]])
                start = np.concatenate([at[f"t{j}"], at[f"x{j}"]])
                form.square(self._name(j, "N"), now - at[f"h{j}"], 1 / x.least)
            form.square(self._name(j, "X_a"), z, x.rest / x.u)
            form.square(self._name(j, "U"), z, 1 / x.u)
            form.twice(self._name(j, "X_b"), z, start, x.rest / x.u)
        return form
