"""The LMI that analyses a given loop whose ages are known, for an SDP solver.

The inequalities are those of `cosim.hinf.certificate.ages_proof`, which proves them again from
the functional; docs/explanation/theory.md derives them. For u = K x with K given they are linear
in all unknowns, and affine in every age, so that Phi < 0 at the corners is enough.

One small LMI for each part of the loop (`parts`), tied by gamma and eps alone: the four axes of
the vehicle are solved in seconds instead of minutes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cosim.hinf.certificate import (
    AgeFunctional,
    AgesVariables,
    AgeTerms,
    is_symmetric_unknown,
    rows_of,
    state_blocks,
    unknowns_of,
)
from cosim.hinf.lmi.ages_forms import Form, LateAge, PartOfLoop, count_of
from cosim.hinf.lmi.conic import Constraint
from cosim.hinf.lmi.loop_lmi import Constraints, LoopLmi
from cosim.hinf.lmi.svec import Array, svec, symmetric

if TYPE_CHECKING:
    from cosim.models import Delay, DelaySystem

Indices = NDArray[np.intp]


@dataclass(frozen=True)
class _Part:
    """The states, disturbances and columns of E that belong together, by index."""

    states: Indices
    w: Indices
    p: Indices


class AgesLmi(LoopLmi[AgesVariables]):
    """The LMI of one loop at one order, to be solved at any delays.

    Parameters
    ----------
    system : Eq. (7).
    K : (m, n) the gain, zero for the system as it is.
    order : N, of every constant part; from order 1 on the rest is Wirtinger-based as well.
    functionals : by delay, of those that hold for it (`ages_terms.choices`).
    performance : bound the gain from w to z, instead of stability alone.
    """

    def __init__(
        self,
        system: DelaySystem,
        K: Array,
        order: int,
        functionals: Sequence[AgeFunctional],
        *,
        performance: bool,
    ) -> None:
        super().__init__(system, K, performance=performance)
        self.order, self._system = order, system
        self.functionals = tuple(functionals)
        self._parts = self._separated()

    def _separated(self) -> list[_Part]:
        """Return the parts that no matrix connects."""
        x, w, p = (self._part[name] for name in "xwp")
        w = w if self._performance else w[:0]
        return [  # a column of E that is zero adds nothing
            _Part(*(np.flatnonzero(label == own) for label in (x, w, p)))
            for own in np.unique(np.concatenate([x, w]))
        ]

    def largest_part(self, delays: Sequence[float]) -> int:
        """Return the most rows that -Phi has in one part."""
        return max(sum(self._sizes(part, delays).values()) for part in self._parts)

    def unknowns(self, delays: Sequence[float]) -> int:
        """Return the number of unknowns."""
        return sum(count_of(name, shape) for name, shape in self._unknowns(delays).items())

    def _matrices(self, part: _Part) -> dict[str, list[Array]]:
        """Return the loop's matrices, cut to one part."""
        inside, outputs = np.ix_(part.states, part.states), (slice(None), part.states)
        return {
            "A": [A[inside] for A in self._A],
            "H": [H[outputs] for H in self._H],
            "D": [D[outputs] for D in self._D],
            "C": [self._C[np.ix_(part.states, part.w)]],
            "E": [self._E[np.ix_(part.states, part.p)]],
            "D1": [self._D1[:, part.w]],
        }

    def _late(self, delays: Sequence[float]) -> list[LateAge]:
        return [
            LateAge(i, own, d / self._T, x.least_age / self._T, x.rate or 0.0)
            for i, (own, d, x) in enumerate(
                zip(self.functionals, delays, self._system.delays, strict=True)
            )
            if d > 0
        ]

    def _at(self, delays: Sequence[float]) -> tuple[DelaySystem, tuple[AgeFunctional, ...]]:
        """Return the system with these delays, and the functionals of those that are positive."""
        changed: list[Delay] = [
            replace(x, d=d, least_age=x.least_age if d else 0.0)
            for x, d in zip(self._system.delays, delays, strict=True)
        ]
        own = tuple(f for f, d in zip(self.functionals, delays, strict=True) if d > 0)
        return replace(self._system, delays=tuple(changed)), own

    def _unknowns(self, delays: Sequence[float]) -> dict[str, tuple[int, int]]:
        """Return names ("part P", "part delay R", "eps") and shapes, in the order of a point."""
        system, own = self._at(delays)
        n, shapes = len(self._back), {}
        blocks = len(state_blocks(system, self.order, own))
        each = unknowns_of(system, self.order, own, gamma=self._performance)
        for c, part in enumerate(self._parts):
            size = part.states.size
            shapes[f"{c} P"] = (blocks * size, blocks * size)
            for j, names in enumerate(each):
                for name, (rows, columns) in names.items():
                    height = rows // n * size
                    if name == "Y":
                        height = sum(self._sizes(part, delays).values())
                    shapes[f"{c} {j} {name}"] = (height, columns // n * size)
        return shapes | dict.fromkeys(self._blocks, (1, 1))

    def _sizes(self, part: _Part, delays: Sequence[float]) -> dict[str, int]:
        """Return the rows of -Phi of one part."""
        system, own = self._at(delays)
        rows = rows_of(system, self.order, own, gamma=self._performance)
        special = {"w": part.w.size, "p": part.p.size}
        return {name: special.get(name, part.states.size) for name in rows}

    def _constraints(
        self,
        delays: Sequence[float],
        gamma: float,
        *,
        fixed: bool,
        down_to_zero: bool = False,
    ) -> Constraints:
        places: dict[str, slice] = {}
        width = 0
        for name, shape in self._unknowns(delays).items():
            places[name] = slice(width, width + count_of(name, shape))
            width = places[name].stop
        width += not fixed
        phi, positive = [], []
        system, functionals = self._at(delays)
        late, blocks = self._late(delays), state_blocks(system, self.order, functionals)
        for c, part in enumerate(self._parts):
            sizes = self._sizes(part, delays)
            channels = {
                name: (np.isin(part.p, np.arange(len(self._part["p"]))[columns]), rows)
                for name, (columns, rows) in self._blocks.items()
            }
            matrices = self._matrices(part)
            loop = PartOfLoop(c, self.order, late, matrices, sizes, blocks, channels)
            for form in loop.forms(gamma, down_to_zero=down_to_zero):
                own = form.constraint(places, width)
                whole = Constraint(own.size, -own.constant, -own.columns)
                if form.supplied is not None and fixed:
                    whole = replace(whole, constant=whole.constant + svec(gamma * form.supplied))
                elif form.supplied is not None:
                    whole.columns[:, -1] += svec(gamma * form.supplied)
                phi.append(whole)
            positive += [form.constraint(places, width) for form in loop.positive()]
        for name in self._blocks:
            one = Form(1)
            one.multiple(name, np.eye(1))
            positive.append(one.constraint(places, width))
        return phi, positive

    def _variables(
        self, point: Array, delays: Sequence[float], gamma: float | None, *, down_to_zero: bool
    ) -> AgesVariables:
        """Return a point in the system's own units, its parts put together."""
        system, own = self._at(delays)
        n, T, late = len(self._back), self._T, self._late(delays)
        values, start = {}, 0
        for name, (height, width) in self._unknowns(delays).items():
            square = is_symmetric_unknown(name.split()[-1])
            count = height * (height + 1) // 2 if square else height * width
            entries = point[start : start + count]
            values[name] = symmetric(entries, height) if square else entries.reshape(height, width)
            start += count
        blocks = state_blocks(system, self.order, own)
        units = np.array([self._unit_of_block(name, late) for name in blocks])
        P = np.zeros((len(blocks) * n, len(blocks) * n))
        rows = rows_of(system, self.order, own, gamma=self._performance)
        shapes = unknowns_of(system, self.order, own, gamma=self._performance)
        terms = [AgeTerms(x, {}) for x in own]
        for own_terms, names in zip(terms, shapes, strict=True):
            own_terms.matrices.update({name: np.zeros(shape) for name, shape in names.items()})
        for c, part in enumerate(self._parts):
            S = self._back[part.states]
            at = (np.arange(len(blocks))[:, None] * n + part.states).ravel()
            scale = (units[:, None] * S).ravel()
            P[np.ix_(at, at)] = T * scale[:, None] * values[f"{c} P"] * scale
            places, factors = self._rows_of_part(rows, part)
            for j, x in enumerate(late):
                for name, matrix in terms[j].matrices.items():
                    value = values[f"{c} {j} {name}"]
                    # stacked maps have n rows each, in the whole as in the part
                    across = (np.arange(matrix.shape[1] // n)[:, None] * n + part.states).ravel()
                    right = np.tile(S, matrix.shape[1] // n)
                    down, left = (places, factors) if name == "Y" else (across, right)
                    matrix[np.ix_(down, across)] = (
                        self._unit_of(name, x) * left[:, None] * value * right
                    )
        return AgesVariables(
            order=self.order,
            P=P,
            terms=tuple(terms),
            eps=self._multipliers(values),
            gamma=gamma,
            down_to_zero=down_to_zero,
        )

    def _rows_of_part(self, rows: dict[str, int], part: _Part) -> tuple[Indices, Array]:
        """Return where the rows of a part stand in the whole, and their units."""
        places, factors, start = [], [], 0
        for name, size in rows.items():
            unit = self._T if name.startswith("r") else 1.0
            own, factor = {
                "w": (part.w, np.ones(part.w.size)),
                "p": (part.p, 1.0 / self._channel[part.p]),
            }.get(name, (part.states, unit * self._back[part.states]))
            places.append(start + own)
            factors.append(factor)
            start += size
        return np.concatenate(places).astype(np.intp), np.concatenate(factors)

    def _unit_of_block(self, name: str, late: list[LateAge]) -> float:
        """Return the unit of a block of y: 1 for a value, 1/time for an integral."""
        if name[0] in "xh":
            return 1.0
        x = late[int(name.strip("Wab").split(",")[0])]
        return 1.0 / (self._T * (x.s if name[0] == "W" else x.u))

    def _unit_of(self, name: str, x: LateAge) -> float:
        """Return the factor between a matrix in own units and in the system's."""
        return {
            "R": 1 / x.s**2,
            "Z": 1 / x.u**2,
            "M": 1 / x.u**2,
            "W": 1 / x.u**2,
            "N": self._T**2,
            "U": self._T / x.u,
            "X_a": 1 / x.u,
            "X_b": 1 / x.u,
            "Y": 1 / x.u,
        }.get(name, 1.0)
