"""Fractions, matrices, positive definiteness and Eq. (7) for `checker.py`; no code of others."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable
from fractions import Fraction
from itertools import chain
from typing import Any


class RefusedError(Exception):
    """The claim is not proved, or this is no certificate."""


def need(holds: object, why: str) -> None:
    """Refuse unless something holds."""
    if not holds:
        raise RefusedError(why)


class M(dict[tuple[int, int], Any]):
    """A matrix: (row, column) -> value, zeros left out."""

    def __add__(self, other: M) -> M:
        more = {key: self.get(key, 0) + x for key, x in other.items()}
        return M({key: x for key, x in {**self, **more}.items() if x})

    def __rmul__(self, factor: Any) -> M:
        return M({key: factor * x for key, x in self.items() if factor})

    def __matmul__(self, other: M) -> M:
        rows: dict[int, list[tuple[int, Any]]] = {}
        for (k, j), x in other.items():
            rows.setdefault(k, []).append((j, x))
        product = M()
        for (i, k), y in self.items():
            for j, x in rows.get(k, ()):
                product[i, j] = product.get((i, j), 0) + y * x
        return product

    @property
    def T(self) -> M:
        """The transpose."""
        return M({(j, i): x for (i, j), x in self.items()})

    def at(self, row: int, column: int) -> M:
        """The same, moved."""
        return M({(i + row, j + column): x for (i, j), x in self.items()})


def eye(n: int) -> M:
    """The identity."""
    return M({(i, i): Fraction(1) for i in range(n)})


def total(matrices: Iterable[M]) -> M:
    """The sum."""
    return sum(matrices, M())


class Form:
    """A quadratic form: self[name] selects its rows of that name, add(L, R) adds L'R + R'L."""

    def __init__(self, rows: Iterable[tuple[str, int]]) -> None:
        self.n, self.matrix, self._at = 0, M(), {}
        for name, size in rows:
            self._at[name] = eye(size).at(0, self.n)
            self.n += size

    def __getitem__(self, name: str) -> M:
        return self._at.get(name, M())

    def add(self, L: M, R: M, weight: Any = 1) -> None:
        """Add weight (L'R + R'L)."""
        term = weight * (L.T @ R)
        self.matrix = self.matrix + term + term.T

    def square(self, L: M, A: M, weight: Any = 1) -> None:
        """Add weight L'A L, A symmetric."""
        self.add(L, A @ L, Fraction(weight) / 2)


def positive(A: M, n: int, name: str) -> None:
    """Refuse unless A > 0: elimination, A = L diag(pivots) L', in integers of 2^-bits.

    A floor errs by less than 1 in every entry, and so by less than the number of rows in norm:
    as much is taken off the diagonal, so that what is left is below the exact remainder.
    """
    A = A + M()
    need(A == A.T, f"{name} is not symmetric")
    need(all(A.get((i, i), 0) > 0 for i in range(n)), f"{name} is not positive definite")
    sizes = [A[i, i].numerator.bit_length() - A[i, i].denominator.bit_length() for i in range(n)]
    for bits in (160, 640, 2560):
        columns: list[dict[int, int]] = [{} for _ in range(n)]
        for (i, j), x in A.items():
            if i >= j:
                unit = Fraction(2) ** (bits - sizes[i] // 2 - sizes[j] // 2)
                columns[j][i] = x * unit // 1 - n * (i == j)
        for column in columns:
            (_, pivot), *rest = sorted(column.items())
            if pivot <= 0:
                break
            for k, (i, x) in enumerate(rest):
                for j, y in rest[: k + 1]:
                    taken_off = len(rest) * (i == j)
                    columns[j][i] = columns[j].get(i, 0) - x * y // pivot - taken_off
        else:
            return
    raise RefusedError(f"{name} is not positive definite")


def above_exp(x: Fraction) -> Fraction:
    """Return a bound of e^x, x >= 0.

    50 terms of Taylor's series at x / 2^k < 1, then k squares, rounded up.
    """
    k, bound = int(x).bit_length(), Fraction(2)
    for i in [*range(50, 0, -1), *[0] * k]:
        bound = 1 + x / 2**k * bound / i if i else bound**2
        bound = -(-bound * 2**300 // 1) / Fraction(2**300)
    return bound


def loaded(content: bytes) -> Any:
    """Read JSON; its numbers are the doubles that they are, as fractions."""

    def double(digits: str) -> Fraction:
        value = Fraction(float(digits))  # refuses an infinity
        need(not digits.lstrip("-").isdigit() or value == int(digits), "an integer is no double")
        return value

    def refuse(name: str) -> None:
        need(not name, f"{name} is no number")

    hooks: dict[str, Any] = {"parse_float": double, "parse_int": double, "parse_constant": refuse}
    return json.loads(content, **hooks)


def number(x: Any) -> Fraction:
    """Read a double."""
    need(isinstance(x, Fraction), "not a double")
    return Fraction(x)


def text(x: Any) -> Fraction:
    """Read "p/q"."""
    need(isinstance(x, str) and re.fullmatch(r"-?[0-9]{1,2000}(/[0-9]{1,2000})?", x), "not p/q")
    return Fraction(x)


def matrix(rows: Any, height: int, width: int, read: Callable[[Any], Fraction] = text) -> M:
    """Read a list of rows."""
    fits = len(rows) == height and all(len(row) == width for row in rows)
    need(fits, f"a matrix is not {height} by {width}")
    return M({(i, j): read(x) for i, row in enumerate(rows) for j, x in enumerate(row)}) + M()


def symmetric(rows: Any, n: int) -> M:
    """Read a symmetric matrix."""
    A = matrix(rows, n, n)
    need(A == A.T, "a matrix is not symmetric")
    return A


def scalar(x: Any, *, needed: object) -> Any:
    """Read "p/q", or null where there is no such number."""
    need((x is not None) == bool(needed), "a number too many, or one too few")
    return None if x is None else text(x)


def values(table: Any, required: str, optional: str = "") -> list[Any]:
    """Return what a table has under its required keys."""
    names = required.split()
    fits = isinstance(table, dict) and {*names} <= {*table} <= {*names, *optional.split()}
    need(fits, f"expected the keys {', '.join(names)}")
    return [table[name] for name in names]


def without_sentences(claim: Any) -> Any:
    """Return a claim without its hypotheses in words."""
    return {key: x for key, x in claim.items() if key != "hypotheses"}


class Loop:
    """Eq. (7) with u = sum_i (K o M_i) x(t - d_i), exactly: index 0 is x(t), index j is delay j.

    n, m, q, p, s, r : sizes of x, u, w, z and F(t); `blocks` those of the blocks of F. A, H, D :
    lists, the loop closed; `open` without K; late_gain : K S_i. a, rate, sampled, varies : what is
    known of an age. fed : `feedback` as given. whole : the whole state is fed back through one.
    """

    def __init__(self, system: dict[str, Any], gain: Any = None) -> None:
        optional = "B C D D1 D2 E H name delays feedback integrals uncertainty_blocks"
        values(system, "A", optional)
        self.delays = system.get("delays", [])
        for x in self.delays:
            values(x, "d", "A H feedback any_age sampled least_age rate")
        tables = [system, *self.delays]
        size: dict[str, int] = {}
        at: dict[tuple[str, int], M] = {}
        for names in ("A nn", "B nm", "C nq", "D pn", "D1 pq", "D2 pm", "E ns", "H rn"):
            key, letters = names.split()
            for i, table in enumerate(tables):
                if key in table:
                    shape = len(table[key]), len(table[key][0])
                    for letter, count in zip(letters, shape, strict=True):
                        need(size.setdefault(letter, count) == count, f"{key} does not fit")
                    at[key, i] = matrix(table[key], *shape, number)
        self.n, self.m, self.q, self.p, self.s, self.r = (size.get(x, 0) for x in "nmqpsr")
        need((self.s > 0) == (self.r > 0), "E without H, or H without E")
        self.blocks = [(self.s, self.r)] if self.s else []
        if "uncertainty_blocks" in system:
            sizes = system["uncertainty_blocks"]
            self.blocks = [(int(number(a)), int(number(b))) for a, b in sizes]
            need([[*pair] for pair in self.blocks] == sizes, "blocks of half a row")
        need(all(min(pair) > 0 for pair in self.blocks), "an empty block")
        sums = [sum(pair[i] for pair in self.blocks) for i in (0, 1)]
        need(sums == [self.s, self.r], "the blocks are not those of E and H")
        need("B" in system or self.m == 0, "D2 without B")
        self.B, self.C, self.D1, self.D2, self.E = (
            at.get((key, 0), M()) for key in ("B", "C", "D1", "D2", "E")
        )
        self.open, self.H = ([at.get((key, i), M()) for i in range(len(tables))] for key in "AH")
        self._read_ages()
        delayed = [x.get("feedback", False) for x in self.delays]
        self.whole = "feedback" not in system and all(x in (False, True) for x in delayed)
        self.fed = [system.get("feedback", self.whole and not any(delayed)), *delayed]
        rows = max(self.m, 1)
        masks = [x if isinstance(x, list) else [x] * self.n for x in self.fed]
        masks = [x if isinstance(x[0], list) else [x] * rows for x in masks]
        need(all(type(x) is bool for x in chain(*chain(*masks))), "feedback is not true or false")
        fits = all(len(x) == rows and all(len(row) == self.n for row in x) for x in masks)
        once = (sum(x[i][j] for x in masks) <= 1 for i in range(rows) for j in range(self.n))
        need(fits and all(once), "states fed back twice")
        self.K = M() if gain is None else matrix(gain, self.m, self.n, number)
        self.late_gain = [
            M({(i, j): x for (i, j), x in self.K.items() if mask[i][j]}) for mask in masks
        ]
        need(total(self.late_gain) == self.K, "a state that is not fed back has a gain")
        self.A = [A + self.B @ x for A, x in zip(self.open, self.late_gain, strict=True)]
        self.open_D = at.get(("D", 0), M())
        open_D = [self.open_D, *(M() for _ in self.delays)]
        self.D = [D + self.D2 @ x for D, x in zip(open_D, self.late_gain, strict=True)]

    def multipliers(self, x: Any) -> list[Fraction]:
        """Read eps: "p/q", a list where F has several blocks, or null."""
        texts = x if len(self.blocks) > 1 else [] if x is None else [x]
        need(len(texts) == len(self.blocks), "not one eps per block of F")
        return [text(each) for each in texts]

    def scalings(self, eps: list[Any]) -> tuple[M, M]:
        """Return diagonals with eps_i on the columns of E and on the rows of H of block i."""
        weights = []
        for i in (0, 1):
            each = [x for pair, x in zip(self.blocks, eps, strict=True) for _ in range(pair[i])]
            weights.append(M({(k, k): x for k, x in enumerate(each)}) + M())
        return weights[0], weights[1]

    def _read_ages(self) -> None:
        flags = [[x.get(key, False) for x in self.delays] for key in ("sampled", "any_age")]
        need(all(type(x) is bool for x in chain(*flags)), "neither true nor false")
        zero = Fraction(0)
        self.d = [zero, *(number(x["d"]) for x in self.delays)]
        self.a = [zero, *(number(x.get("least_age", zero)) for x in self.delays)]
        self.rate = [None, *(number(x["rate"]) if "rate" in x else None for x in self.delays)]
        self.sampled = [False, *flags[0]]
        self.varies = [False, *(any(x) for x in zip(*flags, self._has_rate(), strict=True))]
        for d, a, rate, sampled, varies in zip(
            self.d, self.a, self.rate, self.sampled, self.varies, strict=True
        ):
            need(0 <= a <= d and (a == 0 or (a < d and varies)), "an impossible least age")
            need(rate is None or (rate >= 0 and not sampled), "an impossible rate")

    def _has_rate(self) -> list[bool]:
        return ["rate" in x for x in self.delays]
