"""What is proved of a gain whose delays are known: a functional, and every inequality it needs.

V is y'P y plus the terms of each positive delay, which are about its support y_j = C_j x (`Loop`);
docs/explanation/theory.md derives them and gives the sources. With a = least_age, N the order,
c = (333/106)^2/4 < pi^2/4, |v|_R^2 = v'R v, He M = M + M', x_a = x(t - a), V' is at most

    jensen      any age up to d, order 0:  d^2 |f|_R^2 - |x - x_tau|_R^2
    constant    of length l = d:  |x|_Q^2 - |x_d|_Q^2 + l^2 |f|_R^2 - sum_k (2k+1) |v_k|_R^2,
                v_k the integral of L_k x' over the delay, and l W_k in y, k < N
    The others after the same over a constant part of length a, if a > 0; with l = d - a
    interval    any age from a to d:  |x_a|_S^2 - |x_d|_S^2 + l^2 |f|_Z^2
                - [v; u]'[Zh M; M' Zh][v; u], v = (x_a - x_tau; x_a + x_tau - 2 m_1),
                u = (x_tau - x_d; x_tau + x_d - 2 m_2), Zh = diag(Z, 3 Z), and
                (tau - a) m_1 + (d - tau) m_2 in y; at order 0 only the first rows of v and u
    rate        the same, with |x_a|_S1^2 - (1 - tau')|x_tau|_(S1 - S2)^2 - |x_d|_S2^2 in place
                of S, and (tau - a) m_1, (d - tau) m_2 in y, one by one
    wirtinger   sampled, from a at rate one to d:  l^2 |f|_W^2 - c |x_a - x_tau|_W^2
    looped      the same, sharper. xi all rows, z = (x - x_t; x_a - x_k), z_0 = (x_t; x_k),
                z' = (f; x'_a), x_k = x_tau = x(s_k), x_t = x(s_k + a):
                |f|_N^2 - |x'_a|_N^2 - z'X_a z - He(z'X_b z_0) - He(xi'Y z), x_a in y, and, at
                the start of a hold (age a), l (|z'|_U^2 + He z''(X_a z + X_b z_0)), at its end
                (age d) l He(xi'Y v) - l |v|_U^2 in further rows v; a = 0: z = x - x_k, no N

Phi, with eps (q'q - p'p) + z'z/gamma - gamma w'w, is affine in every tau, its rate and the time
since an instant, so that -Phi > 0 is shown at every corner. Where constant delays are covered down
to a lower one, l of each is d and that one at the corners: y is affine in l, and Phi but for
l^2 |f|_R^2, which is convex. Beside it, > 0: Q, R, S, S_1, S_2, Z, W, N, [Zh M; M' Zh] and

    P + diag(0, (2k+1)/l Q, S/l), and this with |x - x_a|_N^2/a + l (z'X_a z + He z'X_b z_0)
    + |z|_U^2 added for any of the looped delays, in [y; x_t; x_k]: V > 0 at every time.

-Phi > 0 implies every eps > 0 and, with gamma > 0, gamma > |D1|.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import flint

from cosim.hinf.exact import exact
from cosim.hinf.theorems.inequality import (
    Inequality,
    Shape,
    Signal,
    itself,
    shapes_of,
    stack,
)

if TYPE_CHECKING:
    from cosim.hinf.theorems.loop import Loop
    from cosim.models import Delay

Corner = tuple[Any, Any]
"""An age (of a constant delay: its length), and its rate."""
Pairs = list[tuple[Signal, Signal]]
"""Parts of y with their derivatives."""
UNKNOWNS = ("Q", "R", "S", "S_1", "S_2", "Z", "M", "W", "N", "U", "X_a", "X_b", "Y")
"""The names of the matrices of a delay, as files order them."""
NOT_SYMMETRIC = ("M", "X_b", "Y")
_PI_LOWER = flint.fmpq(333, 106)  # a convergent of pi from below; 22/7 and 355/113 lie above it


class Age:
    """The terms of positive delay j; its unknowns are "name[j]".

    Parameters
    ----------
    functional : one of those above.
    order : N.
    lower : the least constant length that is covered (`fmpq`); None: exactly d, or what the
        functional covers by itself.
    """

    def __init__(self, loop: Loop, j: int, functional: str, order: int, lower: Any = None) -> None:
        delay = loop.delays[j]
        self.j, self.functional, self.order, self.lower = j, functional, order, lower
        self.C, self.width = loop.support[j], loop.support[j].nrows()
        self.d, self.least = loop.d[j], exact(delay.least_age)
        self.bound = exact(delay.rate or 0.0)
        self.whole = functional in {"constant", "jensen"}
        self.between = functional in {"interval", "rate"}
        self.part = self.d if self.whole else self.least
        self.rest = self.d - self.least
        first = self.part > 0 and functional != "jensen"
        self.means = [f"W{j},{k}" for k in range(order)] if first else []
        self.late = self.least > 0 and not self.whole
        self.names = self._names()

    def _names(self) -> list[str]:
        """Return its rows of -Phi: y(t - tau) is "x{j}", y(t - a) "h{j}", y(t - d) "d{j}".

        "W{j},{k}" are the means over the constant part, "a{j}", "b{j}" those over [t - tau, t - a]
        and [t - d, t - tau]; "t{j}" is y(s_k + a), "r{j}" y'(t - a).
        """
        j = self.j
        if self.whole:
            return [f"x{j}", *self.means]
        names = [f"h{j}", *self.means] if self.late else []
        names.append(f"x{j}")
        if self.between:
            names += [f"d{j}", *((f"a{j}", f"b{j}") if self.order else ())]
        return names + ([f"t{j}", f"r{j}"] if self.functional == "looped" and self.late else [])

    def in_y(self) -> list[str]:
        """Return the names of its parts of y."""
        names = list(self.means)
        if self.functional == "looped" and self.late:
            names.append(f"h{self.j}")
        if self.between and self.order:
            each = ("ab",) if self.functional == "interval" else ("a", "b")
            names += [f"{name}{self.j}" for name in each]
        return names

    def corners(self) -> list[Corner]:
        """Return the ages, with their rates, at which -Phi is shown."""
        ends: list[Corner] = [(self.least, 0), (self.d, 0)]
        if self.functional == "rate":
            reached = ends if self.order else ends[:1]  # at order 0 nothing depends on the age
            return [(a, rate) for a, _ in reached for rate in sorted({-self.bound, self.bound})]
        if self.functional == "looped" or (self.functional == "interval" and self.order):
            return ends
        if self.lower is not None and self.lower != self.d:
            return [(self.d, 0), (self.lower, 0)]
        return [(self.d, 0)]

    def positive(self) -> Iterator[Inequality]:
        """Yield what must be positive of its unknowns: each alone, and [Zh M; M' Zh]."""
        names = {"interval": ["S", "Z"], "rate": ["S_1", "S_2", "Z"], "wirtinger": ["W"]}
        matrices = names.get(
            self.functional, ["N"] if self.functional == "looped" and self.late else []
        )
        if self.functional == "jensen":
            matrices = ["R"]
        elif self.part > 0:
            matrices = ["Q", "R", *matrices]
        for name in matrices:
            yield itself(f"{name}[{self.j}]", self.width)
        if self.between:
            count = 1 + (self.order > 0)
            rows = [f"{side}{i}" for side in "vu" for i in range(count)]
            form = Inequality(f"[Z M[{self.j}]; M' Z]", dict.fromkeys(rows, self.width))
            each = [form.row(name) for name in rows]
            for i, row in enumerate(each):
                form.square(f"Z[{self.j}]", row, 2 * (i % count) + 1)
            form.twice(f"M[{self.j}]", stack(each[:count]), stack(each[count:]))
            yield form

    def subtract(self, form: Inequality, f: Signal, at: Corner, xi: Sequence[Signal]) -> Pairs:
        """Subtract its part of V' at a corner; return what is in y, with its derivative.

        f : y'. xi : all rows of -Phi, without those that one corner adds.
        """
        x, now = self.C * form.row("x"), form.row(f"x{self.j}")
        first = form.row(f"h{self.j}") if self.late else x
        pairs: Pairs = []
        if self.part > 0:
            end, length = (now, at[0]) if self.whole else (first, self.part)
            pairs += self._constant(form, f, x, end, length)
        if self.between:
            pairs += self._between(form, f, (first, now), *at)
        elif self.functional == "wirtinger":
            form.square(f"W[{self.j}]", f, -self.rest * self.rest)
            form.square(f"W[{self.j}]", first - now, _PI_LOWER**2 / 4)
        elif self.functional == "looped":
            pairs += self._looped(form, f, stack(xi), at_end=at[0] == self.d)
        return pairs

    def _constant(self, form: Inequality, f: Signal, x: Signal, end: Signal, length: Any) -> Pairs:
        j, pairs = self.j, []
        if self.functional != "jensen":
            form.square(f"Q[{j}]", x, -1)
            form.square(f"Q[{j}]", end)
        form.square(f"R[{j}]", f, -length * length)
        for k in range(len(self.means) + 1):
            change = x + (-1) ** (k + 1) * end  # the integral of L_k y' over the part, by parts
            for i in range((k + 1) % 2, k, 2):
                change = change - 2 * (2 * i + 1) * form.row(self.means[i])
            form.square(f"R[{j}]", change, 2 * k + 1)
            if k < len(self.means):
                pairs.append((length * form.row(self.means[k]), change))
        return pairs

    def _between(
        self, form: Inequality, f: Signal, ends: tuple[Signal, Signal], age: Any, rate: Any
    ) -> Pairs:
        j, slope, (first, now), last = self.j, 1 - rate, ends, form.row(f"d{self.j}")
        young, old = [first - now], [now - last]
        if self.order:
            young.append(first + now - 2 * form.row(f"a{j}"))
            old.append(now + last - 2 * form.row(f"b{j}"))
        form.square(f"Z[{j}]", f, -self.rest * self.rest)
        for change in (young, old):
            for k, each in enumerate(change):
                form.square(f"Z[{j}]", each, 2 * k + 1)
        form.twice(f"M[{j}]", stack(young), stack(old))
        one, two = (f"S[{j}]",) * 2 if self.functional == "interval" else (f"S_1[{j}]", f"S_2[{j}]")
        form.square(one, first, -1)
        form.square(two, last)
        if self.functional == "rate":
            form.square(one, now, slope)
            form.square(two, now, -slope)
        if not self.order:
            return []
        a, b = (age - self.least) * form.row(f"a{j}"), (self.d - age) * form.row(f"b{j}")
        if self.functional == "interval":
            return [(a + b, first - last)]
        return [(a, first - slope * now), (b, slope * now - last)]

    def _z(self, form: Inequality) -> tuple[Signal, Signal]:
        """Return z and z_0 of a looped functional."""
        x, now = self.C * form.row("x"), form.row(f"x{self.j}")
        if not self.late:
            return x - now, now
        t = form.row(f"t{self.j}")
        return stack([x - t, form.row(f"h{self.j}") - now]), stack([t, now])

    def _looped(self, form: Inequality, f: Signal, xi: Signal, *, at_end: bool) -> Pairs:
        j, (z, z_0), rate, pairs = self.j, self._z(form), f, []
        if self.late:
            end = form.row(f"r{j}")
            form.square(f"N[{j}]", f, -1)
            form.square(f"N[{j}]", end)
            rate, pairs = stack([f, end]), [(form.row(f"h{j}"), end)]
        form.square(f"X_a[{j}]", z)
        form.twice(f"X_b[{j}]", z, z_0)
        form.twice(f"Y[{j}]", xi, z)
        if at_end:
            form.twice(f"Y[{j}]", xi, form.row(f"v{j}"), -self.rest)
            form.square(f"U[{j}]", form.row(f"v{j}"), self.rest)
        else:
            form.square(f"U[{j}]", rate, -self.rest)
            form.twice(f"X_a[{j}]", rate, z, -self.rest)
            form.twice(f"X_b[{j}]", rate, z_0, -self.rest)
        return pairs

    def add_value(self, form: Inequality, *, sampled: bool) -> None:
        """Add what its terms of V are at least, beside y'P y; `sampled` : as a hold begins."""
        j = self.j
        for k, name in enumerate(self.means):
            form.square(f"Q[{j}]", form.row(name), (2 * k + 1) / self.part)
        for row, S in (("ab", "S"), ("a", "S_1"), ("b", "S_2")):
            if f"{row}{j}" in form.rows:
                form.square(f"{S}[{j}]", form.row(f"{row}{j}"), 1 / self.rest)
        if sampled:
            z, z_0 = self._z(form)
            if self.late:
                change = self.C * form.row("x") - form.row(f"h{j}")
                form.square(f"N[{j}]", change, 1 / self.part)
            form.square(f"X_a[{j}]", z, self.rest)
            form.square(f"U[{j}]", z)
            form.twice(f"X_b[{j}]", z, z_0, self.rest)


def age_inequalities(loop: Loop, ages: Sequence[Age], *, bounded: bool) -> Iterator[Inequality]:
    """Yield everything that must be positive, -Phi at every corner last.

    Parameters
    ----------
    ages : the terms of every positive delay.
    bounded : whether there is a gamma, instead of stability alone.
    """
    yield from positive_of_ages(loop.A[0].nrows(), ages)
    for corner in corners_of(ages):
        yield minus_phi(loop, ages, corner, bounded=bounded)


def corners_of(ages: Sequence[Age]) -> Iterator[tuple[Corner, ...]]:
    """Yield every age and rate of every positive delay at which -Phi is shown."""
    return itertools.product(*(age.corners() for age in ages))


def positive_of_ages(n: int, ages: Sequence[Age]) -> Iterator[Inequality]:
    """Yield what must be positive beside -Phi; `n` : how many states there are."""
    for age in ages:
        yield from age.positive()
    looped = [age for age in ages if age.functional == "looped"]
    for count in range(len(looped) + 1):
        for sampled in itertools.combinations(looped, count):
            yield _value(n, ages, sampled)


def shapes_of_ages(loop: Loop, ages: Sequence[Age], *, bounded: bool) -> dict[str, Shape]:
    """Return the shape of every unknown: one corner has them all, and V says which is symmetric."""
    corner = next(corners_of(ages))
    phi = minus_phi(loop, ages, corner, bounded=bounded)
    return shapes_of([_value(loop.A[0].nrows(), ages, ()), phi])


def _value(n: int, ages: Sequence[Age], sampled: Sequence[Age]) -> Inequality:
    """Return P with what the other terms add to V, at the start of a hold of `sampled`."""
    y = {"x": n} | {name: age.width for age in ages for name in age.in_y()}
    more = {
        name: age.width
        for age in sampled
        for name in (*([f"t{age.j}"] if age.late else []), f"x{age.j}")
    }
    at = ", ".join(str(age.j) for age in sampled)
    at = f", with what X_a, X_b add of {at}," if at else ","
    form = Inequality(f"P, with what Q and S add to it{at}", y | more)
    form.square("P", stack([form.row(name) for name in y]))
    for age in ages:
        age.add_value(form, sampled=age in sampled)
    return form


def minus_phi(
    loop: Loop, ages: Sequence[Age], corner: Sequence[Corner], *, bounded: bool
) -> Inequality:
    """Return -Phi at a corner: the age and rate of every positive delay."""
    rows = {"x": loop.A[0].nrows()} | {name: age.width for age in ages for name in age.names}
    rows |= loop.rows(bounded=bounded)
    at = _corner_text(ages, corner)
    form = Inequality(f"-Phi at {at}" if at else "-Phi", rows | rows_of_corner(ages, corner))
    xi = [form.row(name) for name in rows]
    on = [form.row("x"), *(form.row(f"x{age.j}") for age in ages)]
    f = loop.rate(form, on)
    subtract_derivative(form, ages, corner, f, xi)
    loop.subtract_gain_and_uncertainty(form, on, bounded=bounded)
    return form


def rows_of_corner(ages: Sequence[Age], corner: Sequence[Corner]) -> dict[str, int]:
    """Return the rows that -Phi has at one corner alone: v, at the end of a hold."""
    return {
        f"v{age.j}": age.width * (1 + age.late)
        for age, (at, _) in zip(ages, corner, strict=True)
        if age.functional == "looped" and at == age.d
    }


def subtract_derivative(
    form: Inequality,
    ages: Sequence[Age],
    corner: Sequence[Corner],
    f: Signal,
    xi: Sequence[Signal],
) -> None:
    """Subtract V' at a corner, x' = f; `xi` : all rows without those of the corner."""
    pairs = [(form.row("x"), f)]
    for age, there in zip(ages, corner, strict=True):
        pairs += age.subtract(form, age.C * f, there, xi)
    form.twice("P", stack([y for y, _ in pairs]), stack([rate for _, rate in pairs]), -1)


def widest_functional(delay: Delay) -> str:
    """Return the functional that takes a varying age as any one from zero to its bound."""
    return "jensen" if delay.any_age else "constant"


def _corner_text(ages: Sequence[Age], corner: Sequence[Corner]) -> str:
    texts = [
        f"age {float(at):g}" + (f" and rate {float(rate):g}" if age.functional == "rate" else "")
        for age, (at, rate) in zip(ages, corner, strict=True)
        if len(age.corners()) > 1 or age.functional == "rate"
    ]
    return ", ".join(texts)
