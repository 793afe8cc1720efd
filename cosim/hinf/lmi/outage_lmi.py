"""The LMI of outages: one functional for a loop in touch and out of touch, for an SDP solver.

The forms are those of `cosim.hinf.certificate.outages`, which proves them again. For given rates
alpha and beta they are linear in all unknowns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import flint
import numpy as np

from cosim.hinf.certificate import (
    Outages,
    exact,
    exact_eps,
    exact_matrix,
    exact_symmetric,
    is_above_exponential,
    varies,
)
from cosim.hinf.lmi.ages_forms import Form, count_of
from cosim.hinf.lmi.conic import Constraint, Solution
from cosim.hinf.lmi.loop_lmi import _BOUND, Constraints, LoopLmi, _widest_margin
from cosim.hinf.lmi.parts import Labels, parts_of, solve_in_parts
from cosim.hinf.lmi.svec import Array, svec, symmetric

if TYPE_CHECKING:
    from fractions import Fraction

    from cosim.models import DelaySystem


class OutageLmi(LoopLmi[Outages]):
    """The LMI of one loop and its fallback, at rates that can be changed.

    Parameters
    ----------
    system : Eq. (7), `outage_delay` its feedback.
    K : (m, n) the gain in touch.
    fallback : (m, n) the gain out of touch.
    fallback_age : its greatest age [s]; 0: it acts at once.
    performance : bound the weighted gain from w to z.
    """

    def __init__(
        self,
        system: DelaySystem,
        K: Array,
        fallback: Array,
        fallback_age: float,
        *,
        performance: bool,
    ) -> None:
        super().__init__(system, K, performance=performance)
        self._system, self._fallback, self._age = system, fallback, fallback_age
        back = self._back
        self._acting = self._T * back[:, None] * system.B @ fallback / back
        self._seen = system.D2 @ fallback / back
        opened = [system.A, *(delay.A for delay in system.delays)]
        self._open = [self._T * back[:, None] * M / back for M in opened]
        self._late = [i for i, delay in enumerate(system.delays, 1) if delay.d > 0]
        links = [*self._links, ("x", "x", self._acting), *(("x", "x", A) for A in self._open)]
        links += [("z", "x", self._seen), ("z", "x", self._open_D())] if performance else []
        self._part = parts_of(links)
        self._solver = self._solved_in_parts
        self.set_rates(1, 1)

    def set_rates(self, alpha: Fraction | int, beta: Fraction | int | None) -> None:
        """Set alpha and beta [1/s]; beta None: in touch alone."""
        self.alpha, self.beta = alpha, beta
        self.rho = [_below_decay(alpha, delay.d) for delay in self._system.delays if delay.d > 0]

    def is_met(self, gamma: float | None) -> bool:
        """Whether the solver finds a point with a margin."""
        constraints = self._constraints((), gamma or 1.0, fixed=True)
        found = _widest_margin(
            constraints, _BOUND, lambda _: True, enough=np.inf, solver=self._solver
        )
        return found is not None and found[0] > 0

    def unknowns(self, delays: Sequence[float]) -> int:
        """Return the number of unknowns."""
        del delays
        return sum(count_of(name, shape) for name, shape in self._unknowns().items())

    def _unknowns(self) -> dict[str, tuple[int, int]]:
        n = len(self._back)
        shapes = {"P": (n, n)}
        for i in self._late:
            names = ("S", "R", "M") if varies(self._system.delays[i - 1]) else ("S", "R")
            shapes |= {f"{i} {name}": (n, n) for name in names}
        for name in self._blocks:
            shapes |= {name: (1, 1)} | ({f"{name} out": (1, 1)} if self.beta is not None else {})
        return shapes

    def _solved_in_parts(
        self, constraints: Sequence[Constraint], q: Array, *, tolerance: float
    ) -> Solution:
        """Solve with each matrix cut into parts; Phi comes first, then P, S, .., once or twice."""
        x = self._part["x"]
        labels: list[Labels | None] = []
        for lost in (False, True) if self.beta is not None else (False,):
            sizes, _ = self._rows(lost=lost)
            own = {"w": self._part.get("w"), "p": self._part["p"]}
            each = [own.get(name, x) for name in sizes]
            labels.append(np.concatenate([one for one in each if one is not None]))
        names = self._unknowns()
        of_positive = [
            None
            if name in self._blocks or name.endswith(" out")
            else np.tile(x, 1 + (" M" in name))
            for name in names
        ]
        labels += of_positive
        if len(constraints) > len(labels) + 1:
            labels += of_positive
        labels += [None] * (len(constraints) - len(labels))
        return solve_in_parts(constraints, labels, q, tolerance=tolerance)

    def _rows(self, *, lost: bool) -> tuple[dict[str, int], dict[int, str]]:
        """Return the rows of -Phi of one mode, and which are those of each positive delay now."""
        n = len(self._back)
        sizes, now = {"x": n}, {}
        for i in self._late:
            delay = self._system.delays[i - 1]
            gone = lost and bool(delay.feedback) and self._age == 0
            now[i] = f"x{i}" if varies(delay) and not gone else f"d{i}"
            sizes |= dict.fromkeys([now[i], f"d{i}"], n)
        if self._performance:
            sizes["w"] = self._C.shape[1]
        return sizes | {"p": self._E.shape[1]}, now

    def _constraints(
        self, delays: Sequence[float], gamma: float, *, fixed: bool, down_to_zero: bool = False
    ) -> Constraints:
        del delays, down_to_zero
        places: dict[str, slice] = {}
        width = 0
        for name, shape in self._unknowns().items():
            places[name] = slice(width, width + count_of(name, shape))
            width = places[name].stop
        width += not fixed
        phi = []
        for lost in (False, True) if self.beta is not None else (False,):
            form = self._minus_phi(gamma, lost=lost)
            if form.supplied is not None and fixed:
                form.constant = form.constant + gamma * form.supplied
            one = form.constraint(places, width)
            if form.supplied is not None and not fixed:
                one.columns[:, -1] += svec(gamma * form.supplied)
            phi.append(one)
        positive = []
        n = len(self._back)
        for name, (size, _) in self._unknowns().items():
            form = Form(size)
            if name.endswith(" M"):
                form = Form(2 * n)
                v, u = np.eye(n, 2 * n), np.eye(n, 2 * n, n)
                for each in (v, u):
                    form.square(name.replace("M", "R"), each)
                form.twice(name, v, u)
            else:
                form.square(name, np.eye(size))
            positive.append(form.constraint(places, width))
        return phi, positive

    def _minus_phi(self, gamma: float, *, lost: bool) -> Form:
        """Return -Phi of one mode."""
        T = self._T
        sizes, now = self._rows(lost=lost)
        total, start, at = sum(sizes.values()), 0, {}
        for name, size in sizes.items():
            at[name] = np.eye(size, total, start)
            start += size
        count = len(self._system.delays)
        on = [at["x"], *(at[now[i]] if i in now else at["x"] for i in range(1, count + 1))]
        feedback = next(i for i in self._late if self._system.delays[i - 1].feedback)
        back = on[feedback] if self._age > 0 else at["x"]
        f = np.asarray(sum(A @ x for A, x in zip(self._open if lost else self._A, on, strict=True)))
        f = f + self._E @ at["p"] + (self._acting @ back if lost else 0.0)
        if self._performance:
            f = f + self._C @ at["w"]
        form, x = Form(total), at["x"]
        rate = float(self.beta if lost and self.beta is not None else -self.alpha) * T
        form.twice("P", x, f, -1.0)
        form.square("P", x, 2 * rate)
        for i, rho in zip(self._late, self.rho, strict=True):
            d, r, end = self._system.delays[i - 1].d / T, float(rho), at[f"d{i}"]
            unit = max(1.0, d) ** 2
            again = lost and i == feedback
            form.square(f"{i} S", x, -1.0)
            form.square(f"{i} S", end, r)
            form.square(f"{i} R", f, -(d**2) / unit)
            near = r * d * T / self._age if again and self._age > 0 else r
            form.square(f"{i} R", x - at[now[i]], near / unit)
            form.square(f"{i} R", at[now[i]] - end, r / unit)
            if now[i] != f"d{i}" and not again:
                form.twice(f"{i} M", x - at[now[i]], at[now[i]] - end, r / unit)
        q = np.asarray(sum(H @ y for H, y in zip(self._H, on, strict=True)))
        for name, (columns, rows) in self._blocks.items():
            p, own = at["p"][columns], q[rows]
            form.multiple(f"{name} out" if lost else name, p.T @ p - own.T @ own)
        if self._performance:
            out = [self._open_D(), *(0 * D for D in self._D[1:])] if lost else self._D
            z = np.asarray(sum(D @ y for D, y in zip(out, on, strict=True)))
            z = z + self._D1 @ at["w"] + (self._seen @ back if lost else 0.0)
            form.constant, form.supplied = -z.T @ z / gamma, at["w"].T @ at["w"]
        return form

    def _open_D(self) -> Array:
        return np.asarray(self._system.D / self._back)

    def _variables(
        self, point: Array, delays: Sequence[float], gamma: float | None, *, down_to_zero: bool
    ) -> Outages:
        del delays, down_to_zero
        values, start = {}, 0
        for name, (height, width) in self._unknowns().items():
            count = count_of(name, (height, width))
            own = point[start : start + count]
            square = name.endswith(" M")
            values[name] = own.reshape(height, width) if square else symmetric(own, height)
            start += count
        back, T, system = self._back, self._T, self._system

        def matrix(name: str, factor: float) -> Array:
            return np.asarray(factor * back[:, None] * values[name] * back)

        units = {i: max(1.0, system.delays[i - 1].d / T) ** 2 for i in self._late}
        out = {name: values.get(f"{name} out", values[name]) for name in self._blocks}
        return Outages(
            alpha=_rational(self.alpha),
            beta=_rational(self.alpha if self.beta is None else self.beta),
            gamma=None if gamma is None else exact(gamma),
            rho=tuple(exact(x) for x in self.rho),
            fallback=self._fallback,
            fallback_age=self._age,
            P=exact_symmetric(matrix("P", T)),
            S=tuple(exact_symmetric(matrix(f"{i} S", 1.0)) for i in self._late),
            R=tuple(exact_symmetric(matrix(f"{i} R", 1 / units[i])) for i in self._late),
            M=tuple(
                exact_matrix(matrix(f"{i} M", 1 / units[i])) if f"{i} M" in values else None
                for i in self._late
            ),
            eps=exact_eps(system, self._multipliers(values)),
            eps_out=exact_eps(system, self._multipliers(out)),
        )


def _below_decay(alpha: Fraction | int, d: float) -> float:
    """Return a double at most e^{-2 alpha d}."""
    power = 2 * _rational(alpha) * exact(d)
    value = math.exp(-float(power))
    while not is_above_exponential(1 / exact(value), power):
        value = math.nextafter(value, 0.0)
    return value


def _rational(value: Fraction | int) -> Any:
    return flint.fmpq(value.numerator, value.denominator)
