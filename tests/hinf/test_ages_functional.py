"""The forms of the proof bound the derivative of V, computed from V itself along any motion.

x(t) is a random polynomial; w = x' - sum A_i x(t - tau_i) makes it a motion of the loop (C = I).
V is integrated numerically (Gauss-Legendre, exact for polynomials), its derivative taken by
central differences, and kept against Phi at random matrices, at the age in between as well: the
form there is the mean of those at the corners. So the equations are tested, apart from any LMI.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from shared import sampled, spread

from cosim.hinf.theorems import (
    UNKNOWNS,
    Age,
    AgesTheorem,
    Inequality,
    Loop,
    Proof,
    Support,
    constants_down_to_zero,
    minus_phi,
    positive_delays,
)
from cosim.models import Delay, DelaySystem

N_STATES = 2
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)


def integral(f: Callable[[float], Any], low: float, high: float) -> Any:
    """The integral over [low, high]."""
    middle, half = (low + high) / 2, (high - low) / 2
    return half * sum(w * f(middle + half * s) for s, w in zip(NODES, WEIGHTS, strict=True))


def q(M: Any, v: Any) -> float:
    return float(v @ M @ v)


class Motion:
    """x(t), a polynomial of degree 4 per state, and its derivative; `bend` 0 makes it a line."""

    def __init__(self, rng: np.random.Generator, bend: float) -> None:
        self._c = rng.standard_normal((5, N_STATES)) * [[1.0], [1.0], *[[bend]] * 3]

    def x(self, t: float) -> Any:
        return sum(c * t**k for k, c in enumerate(self._c))

    def rate(self, t: float) -> Any:
        return sum(k * c * t ** (k - 1) for k, c in enumerate(self._c) if k)


def legendre(k: int, start: float, end: float, s: float) -> float:
    """L_k on [start, end], 1 at the end."""
    return float(np.polynomial.legendre.Legendre.basis(k)((2 * s - start - end) / (end - start)))


def positive(rng: np.random.Generator, n: int) -> Any:
    root = rng.standard_normal((n, n))
    return root @ root.T + 0.1 * np.eye(n)


def no_gain(system: DelaySystem) -> Any:
    return np.zeros(system.B.T.shape)


def random_point(
    system: DelaySystem,
    order: int,
    own: tuple[Any, ...],
    seed: int,
    kept: float | None = None,
    support: Support | None = None,
) -> Any:
    """Positive Q, R, S, Z, W, N, U; M small enough for [Zh M; M' Zh] > 0; the others free.

    With `kept`, the time since the last instant, M and Y are those for which nothing is lost
    where x(t) is a line.
    """
    rng = np.random.default_rng(seed)
    unknowns: dict[str, Any] = {"gamma": 2.0}
    theorem = AgesTheorem(order, own, (support,) * len(own))
    every = theorem.shapes(system, no_gain(system), bounded=True)
    for j in range(len(own)):
        matrices = {}
        for name in (name for name in UNKNOWNS if f"{name}[{j}]" in every):
            shape = every[f"{name}[{j}]"]
            size = shape[:2]
            if name in {"Q", "R", "S", "S_1", "S_2", "Z", "W", "N", "U"}:
                matrices[name] = positive(rng, size[0])
            else:
                value = rng.standard_normal(size)
                matrices[name] = value + value.T if shape.symmetric else value
        if "M" in matrices:
            least = np.linalg.eigvalsh(matrices["Z"])[0]
            matrices["M"] *= 0.9 * least / np.linalg.norm(matrices["M"], 2)
            if kept is not None:
                matrices["M"] *= 0.0
                matrices["M"][:N_STATES, :N_STATES] = 0.999 * matrices["Z"]
        if "Y" in matrices and kept is not None:
            matrices["Y"] = difference_rows(system, order, own).T @ matrices["U"] / kept
        unknowns |= {f"{name}[{j}]": M for name, M in matrices.items()}
    rows = every["P"].height
    P = rng.standard_normal((rows, rows))
    return Proof(theorem, unknowns | {"P": P + P.T})


def difference_rows(system: DelaySystem, order: int, own: tuple[Any, ...]) -> Any:
    """z of the looped functional of the first delay, as a map of all rows."""
    loop = Loop.of(system, np.zeros(system.B.T.shape))
    names = [name for j, one in enumerate(own) for name in Age(loop, j, one, order).names]
    sizes = {"x": N_STATES} | dict.fromkeys(names, N_STATES) | {"w": system.C.shape[1]}
    places = dict(zip(sizes, np.cumsum([0, *sizes.values()]), strict=False))
    pairs = [("x", "t0"), ("h0", "x0")] if system.delays[0].least_age else [("x", "x0")]
    found = np.zeros((N_STATES * len(pairs), sum(sizes.values())))
    for i, (first, second) in enumerate(pairs):
        for k in range(N_STATES):
            found[i * N_STATES + k, places[first] + k] = 1.0
            found[i * N_STATES + k, places[second] + k] = -1.0
    return found


class Functional:
    """V(t) of one motion, and the rows of Phi, for ages given as functions of time.

    y, the states of the support, is x where there is none.
    """

    def __init__(self, system: DelaySystem, v: Any, motion: Motion, age: Any) -> None:
        support = v.theorem.supports[0]
        self.own = list(range(N_STATES)) if support is None else list(support.numbers)
        self.v, self.motion, self.age = v, motion, age
        self.late, self.order = positive_delays(system), v.theorem.order

    def y(self, t: float) -> Any:
        return self.motion.x(t)[self.own]

    def rate(self, t: float) -> Any:
        return self.motion.rate(t)[self.own]

    def part(self, t: float, start: float, end: float, k: int) -> Any:
        """The mean W_k over [t - end, t - start]."""
        total = integral(
            lambda s: legendre(k, t - end, t - start, s) * self.y(s), t - end, t - start
        )
        return total / (end - start)

    def rows(self, t: float) -> dict[str, Any]:
        """Every row of -Phi but w, by the names of `Age`."""
        x, found = self.y, {"x": self.motion.x(t)}
        for j, (own, delay) in enumerate(zip(self.v.theorem.functionals, self.late, strict=True)):
            tau, a, d = self.age(t), delay.least_age, delay.d
            length = d if own == "constant" else a
            for k in range(self.order if length else 0):
                found[f"W{j},{k}"] = self.part(t, 0.0, length, k)
            found[f"h{j}"], found[f"x{j}"], found[f"d{j}"] = x(t - a), x(t - tau), x(t - d)
            if own in {"interval", "rate"}:
                found[f"a{j}"] = self.part(t, a, tau, 0) if tau > a else x(t - a)
                found[f"b{j}"] = self.part(t, tau, d, 0) if d > tau else x(t - d)
            found[f"t{j}"], found[f"r{j}"] = x(t - tau + a), self.rate(t - a)
        return found

    def value(self, t: float) -> float:
        """V(t), from its definition."""
        x, rate, rows = self.y, self.rate, self.rows(t)
        y, total = [rows["x"]], 0.0
        for j, (own, delay) in enumerate(zip(self.v.theorem.functionals, self.late, strict=True)):
            M = {name.removesuffix(f"[{j}]"): each for name, each in self.v.unknowns.items()}
            tau, a, d = self.age(t), delay.least_age, delay.d
            length = d if own == "constant" else a
            if length:
                total += integral(lambda s, M=M: q(M["Q"], x(s)), t - length, t)
                total += length * integral(
                    lambda s, M=M, e=length: (s - t + e) * q(M["R"], rate(s)), t - length, t
                )
                y += [length * rows[f"W{j},{k}"] for k in range(self.order)]
            if own == "looped" and a:
                y.append(rows[f"h{j}"])
                total += integral(lambda s, M=M: q(M["N"], rate(s)), t - a, t)
            if own in {"interval", "rate"}:
                double = integral(
                    lambda s, Z=M["Z"], d=d: (s - t + d) * q(Z, rate(s)), t - d, t - a
                )
                flat = integral(lambda s, M=M: q(M["Z"], rate(s)), t - a, t)
                total += (d - a) * (double + (d - a) * flat)
                first, second = ("S", "S") if own == "interval" else ("S_1", "S_2")
                total += integral(lambda s, S=M[first]: q(S, x(s)), t - tau, t - a)
                total += integral(lambda s, S=M[second]: q(S, x(s)), t - d, t - tau)
                young, old = (tau - a) * rows[f"a{j}"], (d - tau) * rows[f"b{j}"]
                if self.order:
                    y += [young + old] if own == "interval" else [young, old]
            if own == "wirtinger":
                s_k, h = t - tau, d - a
                total += h**2 * integral(lambda s, M=M: q(M["W"], rate(s)), s_k, t)
                total -= (np.pi / 2) ** 2 * integral(
                    lambda s, M=M, k=s_k: q(M["W"], x(s) - x(k)), s_k, t - a
                )
            if own == "looped":
                s_k, left = t - tau, d - tau
                z, kept = x(t) - rows[f"x{j}"], rows[f"x{j}"]
                if a:
                    z = np.concatenate([x(t) - rows[f"t{j}"], rows[f"h{j}"] - kept])
                    kept = np.concatenate([rows[f"t{j}"], kept])
                inside = z @ M["X_a"] @ z + 2 * z @ M["X_b"] @ kept
                both = (lambda s: np.concatenate([rate(s + a), rate(s)])) if a else rate  # noqa: B023
                inside += integral(lambda s: q(M["U"], both(s)), s_k, t - a)  # noqa: B023
                total += left * inside
        whole = np.concatenate(y)
        return total + float(whole @ self.v.unknowns["P"] @ whole)


LEASTS = (0.0, 0.3)
CASES = [
    (own, order, least)
    for own, order, least in itertools.product(
        ("constant", "interval", "rate", "wirtinger", "looped"), (0, 1, 2), LEASTS
    )
    if own != "constant" or not least
]


SECOND = Support("states", (1,))
"""y = x_2, all that acts late where the first column of the delay's matrix is zero."""
ON_SUPPORTS = [(*case, support) for case in CASES for support in (None, SECOND)]

LONGEST = Delay(1.1, [[-0.4, 0.3], [0.2, -0.5]])


def delay_of(own: str, least: float, support: Support | None = None) -> Delay:
    G = [[-0.4 if support is None else 0.0, 0.3], [0.2 if support is None else 0.0, -0.5]]
    if own == "constant":
        return Delay(1.1, G)
    if own == "interval":
        return Delay(1.1, G, any_age=True, least_age=least)
    if own == "rate":
        return Delay(1.1, G, least_age=least, rate=0.5)
    return Delay(1.1, G, least_age=least, sampled=True)


def floats(form: Inequality, v: Proof) -> tuple[Any, list[str]]:
    """A form of the proof as a symmetric array, and the names of its rows."""
    lower = form.at(v.unknowns | {"1/gamma": 1 / v.gamma})
    names = [name for name, size in form.rows.items() for _ in range(size)]
    size = len(lower)
    rows = [[float(e.p) / float(e.q) for e in row] + [0.0] * (size - len(row)) for row in lower]
    M = np.array(rows)
    return M + M.T - np.diag(np.diag(M)), names


def phi_at(system: DelaySystem, v: Any, shares: dict[int, float], slope: float) -> Any:
    """Phi between its corners, as floats, without the rows v: the form after a Schur complement."""
    loop = Loop.of(system, no_gain(system), v.theorem.supports)
    ages = v.theorem.ages(loop)
    found = {}
    for corner in itertools.product(*(age.corners() for age in ages)):
        M, names = floats(minus_phi(loop, ages, corner, bounded=v.gamma is not None), v)
        M = -M
        keep = np.array([not name.startswith("v") for name in names])
        base, more = M[np.ix_(keep, keep)], M[np.ix_(~keep, ~keep)]
        if not keep.all():
            off = M[np.ix_(keep, ~keep)]
            base = base - off @ np.linalg.solve(more, off.T)
        found[corner] = base, [name for name in names if not name.startswith("v")]
    total = 0.0
    for corner, (M, _) in found.items():
        weight = 1.0
        for age, (at, rate) in zip(ages, corner, strict=True):
            moves = age.functional == "rate"
            if len({each for each, _ in age.corners()}) > 1:
                weight *= shares[age.j] if at == age.d else 1 - shares[age.j]
            if moves:
                most = float(age.bound.p) / float(age.bound.q)
                share = (slope + most) / (2 * most)
                weight *= share if rate > 0 else 1 - share
        total = total + weight * M
    return total, next(iter(found.values()))[1]


@pytest.mark.parametrize(("own", "order", "least", "support"), sampled(spread(ON_SUPPORTS, 3), 18))
def test_the_form_bounds_the_derivative_of_v(
    own: str, order: int, least: float, support: Support | None
) -> None:
    """V' + z'z/gamma - gamma w'w <= xi'Phi xi along every motion, and close for gentle ones."""
    system = DelaySystem(
        [[-0.6, 0.4], [-0.3, -0.8]],
        C=np.eye(2),
        D=[[1.0, 0.5]],
        D1=[[0.2, -0.1]],
        delays=[delay_of(own, least, support)],
    )
    delay = system.delays[0]
    gaps = []
    for seed in range(16 if support is None else 4):
        rng = np.random.default_rng([seed, order])
        slope = {"rate": 0.3, "interval": -0.7, "constant": 0.0}.get(own, 1.0)
        at = (
            delay.d if own == "constant" else least + float(rng.uniform(0.05, 0.95)) * (1.1 - least)
        )
        tight = seed % 2 == 0 and own != "constant" and support is None
        kept = at - least if tight else None
        v = random_point(system, order, (own,), seed, kept, support)
        exact = v.exactly(system, no_gain(system))
        motion = Motion(rng, 0.0 if seed % 2 == 0 else 1.0)
        functional = Functional(system, v, motion, lambda t, at=at, m=slope: at + m * t)
        rows, h = functional.rows(0.0), 1e-4
        derivative = (functional.value(h) - functional.value(-h)) / (2 * h)
        x_d = rows["x0"]
        late = delay.A[:, functional.own]
        w = functional.motion.rate(0.0) - system.A @ rows["x"] - late @ x_d
        z = system.D @ rows["x"] + system.D1 @ w
        rate = derivative + float(z @ z) / 2.0 - 2.0 * float(w @ w)
        shares = {0: 1.0 if own == "constant" else (at - least) / (1.1 - least)}
        Phi, names = phi_at(system, exact, shares, slope)
        xi = np.concatenate([(rows | {"w": w})[name] for name in dict.fromkeys(names)])
        bound = float(xi @ Phi @ xi)
        size = abs(rate) + abs(bound) + 1.0
        assert rate <= bound + 1e-6 * size, (seed, rate, bound)
        gaps.append((bound - rate) / size)
    if own != "wirtinger" and support is None:  # its inequality is exact for a sine only
        assert max(gaps[::2]) < 1e-2, gaps


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("share", [0.0, 0.4, 0.8])
def test_constant_delays_down_to_zero_lie_between_their_corners(order: int, share: float) -> None:
    """V of a shorter delay, with the same matrices, against the mean of the forms at d and 0."""
    whole = DelaySystem([[-0.6, 0.4], [-0.3, -0.8]], C=np.eye(2), D=[[1.0, 0.5]], delays=[LONGEST])
    shorter = replace(LONGEST, d=max(share, 1e-6) * LONGEST.d)
    for seed in range(10):
        rng = np.random.default_rng([seed, order, 2])
        v = random_point(whole, order, ("constant",), seed)
        lower = constants_down_to_zero(("constant",))
        v = replace(v, theorem=replace(v.theorem, lower=lower))
        motion = Motion(rng, 1.0)
        functional = Functional(replace(whole, delays=(shorter,)), v, motion, lambda _: shorter.d)
        rows, h = functional.rows(0.0), 1e-4
        derivative = (functional.value(h) - functional.value(-h)) / (2 * h)
        w = motion.rate(0.0) - whole.A @ rows["x"] - LONGEST.A @ rows["x0"]
        z = whole.D @ rows["x"]
        rate = derivative + float(z @ z) / 2.0 - 2.0 * float(w @ w)
        Phi, names = phi_at(whole, v.exactly(whole, no_gain(whole)), {0: share}, 0.0)
        xi = np.concatenate([(rows | {"w": w})[name] for name in dict.fromkeys(names)])
        bound = float(xi @ Phi @ xi)
        assert rate <= bound + 1e-4 * (abs(rate) + abs(bound) + 1.0), (seed, rate, bound)


@pytest.mark.parametrize(("own", "order", "least", "support"), ON_SUPPORTS)
def test_the_other_forms_bound_v_from_below(
    own: str, order: int, least: float, support: Support | None
) -> None:
    """V >= [y; x_t; x_k]'(...)[y; x_t; x_k], between an instant and the next one as well."""
    delay = delay_of(own, least, support)
    system = DelaySystem(-np.eye(2), C=np.eye(2), D=np.eye(2), delays=[delay])
    late = system.delays[0]
    for seed in range(12 if support is None else 4):
        rng = np.random.default_rng([seed, order, 1])
        v = random_point(system, order, (own,), seed, support=support)
        for name in {"R[0]", "Z[0]", "W[0]"} & set(v.unknowns):
            v.unknowns[name] *= 1e-6  # these terms are left out of the bound
        at = late.d if own == "constant" else least + float(rng.uniform(0.05, 0.95)) * (1.1 - least)
        motion = Motion(rng, 0.0 if seed % 2 == 0 else 1.0)
        functional = Functional(system, v, motion, lambda _, at=at: at)
        rows = functional.rows(0.0)
        for k in range(order):
            if f"W0,{k}" in rows:
                rows[f"W0,{k}"] = rows[f"W0,{k}"] * (late.d if own == "constant" else least)
        if own in {"interval", "rate"}:
            rows["a0"], rows["b0"] = (at - least) * rows["a0"], (late.d - at) * rows["b0"]
            rows["ab0"] = rows["a0"] + rows["b0"]
        exact = v.exactly(system, no_gain(system))
        bounds = []
        for form in exact.theorem.inequalities(system, no_gain(system), bounded=True):
            if form.name.startswith("P"):
                M, names = floats(form, exact)
                vector = np.concatenate([rows[name] for name in dict.fromkeys(names)])
                bounds.append(float(vector @ M @ vector))
        share = (late.d - at) / (late.d - least) if own == "looped" else 0.0
        bound = (1 - share) * bounds[0] + share * bounds[-1]
        value = functional.value(0.0)
        assert value >= bound - 1e-9 * (abs(value) + abs(bound)), (seed, value, bound)
