"""The LMI that analyses a given loop whose ages are known, for an SDP solver.

The inequalities are those of `cosim.hinf.certificate.ages_proof`, which proves them again from
the functional; docs/explanation/theory.md derives them. For u = K x with K given they are linear
in all unknowns, and affine in every age, so that Phi < 0 at the corners is enough.

A delay with a support (`ages_terms.Support`) has unknowns and rows for y = C x alone.

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
    Supports,
    is_symmetric_unknown,
    rows_of,
    state_blocks,
    unknowns_of,
)
from cosim.hinf.lmi.ages_forms import Form, LateAge, PartOfLoop, count_of
from cosim.hinf.lmi.conic import Constraint
from cosim.hinf.lmi.interior_point import solve_dense
from cosim.hinf.lmi.loop_lmi import Constraints, LoopLmi
from cosim.hinf.lmi.parts import parts_of
from cosim.hinf.lmi.svec import Array, svec, symmetric

if TYPE_CHECKING:
    from cosim.models import Delay, DelaySystem

Indices = NDArray[np.intp]


@dataclass(frozen=True)
class _Part:
    """The states, disturbances and columns of E that belong together, by index.

    y : so too the entries of y, of every delay of the system.
    """

    states: Indices
    w: Indices
    p: Indices
    y: list[Indices]


@dataclass(frozen=True)
class _Shapes:
    """The rows of -Phi, the blocks of the vector of V, and the unknowns of every positive delay.

    late : the positive delays, by their place in the system.
    """

    rows: dict[str, int]
    blocks: dict[str, int]
    unknowns: list[dict[str, tuple[int, int]]]
    late: list[int]


def _delay_of(name: str) -> int:
    """Return the positive delay to which a row or block belongs: 1 of "W1,0", "ab1"."""
    return int(name.lstrip("Wabdhrtx").split(",")[0])


class AgesLmi(LoopLmi[AgesVariables]):
    """The LMI of one loop at one order, to be solved at any delays.

    Parameters
    ----------
    system : Eq. (7).
    K : (m, n) the gain, zero for the system as it is.
    order : N, of every constant part; from order 1 on the rest is Wirtinger-based as well.
    functionals : by delay, of those that hold for it (`ages_terms.choices`).
    performance : bound the gain from w to z, instead of stability alone.
    supports : of every positive delay of `system`; None: the whole state of each.
    """

    def __init__(
        self,
        system: DelaySystem,
        K: Array,
        order: int,
        functionals: Sequence[AgeFunctional],
        *,
        performance: bool,
        supports: Supports | None = None,
    ) -> None:
        super().__init__(system, K, performance=performance)
        self.order, self._system = order, system
        self.functionals = tuple(functionals)
        given = iter(supports or ())
        self.supports = tuple(
            next(given) if supports is not None and x.d > 0 else None for x in system.delays
        )
        self._select(K)
        self._parts = self._separated()
        if supports is not None:
            self._solver = solve_dense

    def _select(self, K: Array) -> None:
        """Set C of every delay, in units of y, with A', H', D' in place of those of x."""
        n, selections = len(self._back), self._system.selections[1:]
        self._S: list[Array] = []
        self._units: list[Array] = []
        for i, (own, selection) in enumerate(zip(self.supports, selections, strict=True), 1):
            numbers = [] if own is None else list(own.numbers)
            if own is not None and own.of == "controls":
                whole = (K * selection)[numbers] / self._back
                size = np.linalg.norm(whole, axis=1)
                unit = 1.0 / np.where(size > 0, size, 1.0)
                B = self._T * self._back[:, None] * self._system.B
                self._S.append(unit[:, None] * whole)
                self._A[i] = B[:, numbers] / unit
                self._D[i] = self._system.D2[:, numbers] / unit
                self._H[i] = np.zeros((len(self._H[i]), len(numbers)))
            else:
                numbers = list(range(n)) if own is None else numbers
                unit = self._back[numbers]
                self._S.append(np.eye(n)[numbers])
                for each in (self._A, self._D, self._H):
                    each[i] = each[i][:, numbers]
            self._units.append(unit)

    def _separated(self) -> list[_Part]:
        """Return the parts that no matrix connects."""
        if any(own is not None and own.of == "controls" for own in self.supports):
            # a control may belong to states that it does not tie together otherwise
            more = [(f"y{i}", "x", S) for i, S in enumerate(self._S)]
            self._part = parts_of([*self._links, *more])
        x, w, p = (self._part[name] for name in "xwp")
        w = w if self._performance else w[:0]
        y = [x[np.abs(S).argmax(axis=1)] for S in self._S]
        found = []
        for own in np.unique(np.concatenate([x, w])):
            inside = [np.flatnonzero(label == own) for label in y]
            # a column of E that is zero adds nothing
            states, of_w, of_p = (np.flatnonzero(label == own) for label in (x, w, p))
            found.append(_Part(states, of_w, of_p, inside))
        return found

    def largest_part(self, delays: Sequence[float]) -> int:
        """Return the most rows that -Phi has in one part."""
        rows, late = self._shapes(delays).rows, self._positive(delays)
        return max(sum(self._part_of(rows, part, late).values()) for part in self._parts)

    def unknowns(self, delays: Sequence[float]) -> int:
        """Return the number of unknowns."""
        return sum(count_of(name, shape) for name, shape in self._unknowns(delays).items())

    def _matrices(self, part: _Part) -> dict[str, list[Array]]:
        """Return the loop's matrices, cut to one part."""
        columns = [part.states, *part.y]
        return {
            "A": [A[np.ix_(part.states, own)] for A, own in zip(self._A, columns, strict=True)],
            "H": [H[:, own] for H, own in zip(self._H, columns, strict=True)],
            "D": [D[:, own] for D, own in zip(self._D, columns, strict=True)],
            "S": [S[np.ix_(y, part.states)] for S, y in zip(self._S, part.y, strict=True)],
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

    def _positive(self, delays: Sequence[float]) -> list[int]:
        return [i for i, d in enumerate(delays) if d > 0]

    def _shapes(self, delays: Sequence[float]) -> _Shapes:
        """Return the rows, blocks and unknowns of the whole loop at these delays."""
        changed: list[Delay] = [
            replace(x, d=d, least_age=x.least_age if d else 0.0)
            for x, d in zip(self._system.delays, delays, strict=True)
        ]
        system, late = replace(self._system, delays=tuple(changed)), self._positive(delays)
        own = tuple(self.functionals[i] for i in late)
        supports = [self.supports[i] for i in late]
        gamma = self._performance
        return _Shapes(
            rows_of(system, self.order, own, gamma=gamma, supports=supports),
            state_blocks(system, self.order, own, supports),
            unknowns_of(system, self.order, own, gamma=gamma, supports=supports),
            late,
        )

    def _entries(self, name: str, part: _Part, late: list[int]) -> Indices:
        """Return which entries of a row or a block belong to a part: of x, w, p, or of a y."""
        special = {"x": part.states, "w": part.w, "p": part.p}
        return special[name] if name in special else part.y[late[_delay_of(name)]]

    def _unknowns(self, delays: Sequence[float]) -> dict[str, tuple[int, int]]:
        """Return names ("part P", "part delay R", "eps") and shapes, in the order of a point."""
        whole, shapes = self._shapes(delays), {}
        for c, part in enumerate(self._parts):
            size = sum(self._part_of(whole.blocks, part, whole.late).values())
            shapes[f"{c} P"] = (size, size)
            for j, names in enumerate(whole.unknowns):
                width, own = len(self._S[whole.late[j]]), part.y[whole.late[j]].size
                for name, (rows, columns) in names.items():
                    height = rows // width * own
                    if name == "Y":
                        height = sum(self._part_of(whole.rows, part, whole.late).values())
                    shapes[f"{c} {j} {name}"] = (height, columns // width * own)
        return shapes | dict.fromkeys(self._blocks, (1, 1))

    def _part_of(self, rows: dict[str, int], part: _Part, late: list[int]) -> dict[str, int]:
        """Return the sizes that rows or blocks have in one part."""
        return {name: self._entries(name, part, late).size for name in rows}

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
        late, shapes = self._late(delays), self._shapes(delays)
        for c, part in enumerate(self._parts):
            sizes = self._part_of(shapes.rows, part, shapes.late)
            blocks = self._part_of(shapes.blocks, part, shapes.late)
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
        T, late, whole = self._T, self._late(delays), self._shapes(delays)
        values, start = {}, 0
        for name, (height, width) in self._unknowns(delays).items():
            square = is_symmetric_unknown(name.split()[-1])
            count = height * (height + 1) // 2 if square else height * width
            entries = point[start : start + count]
            values[name] = symmetric(entries, height) if square else entries.reshape(height, width)
            start += count
        P = np.zeros((sum(whole.blocks.values()),) * 2)
        each = zip(whole.late, whole.unknowns, strict=True)
        terms = [
            AgeTerms(
                self.functionals[i],
                {name: np.zeros(shape) for name, shape in names.items()},
                self.supports[i],
            )
            for i, names in each
        ]
        for c, part in enumerate(self._parts):
            at, scale = self._places(whole.blocks, part, whole.late)
            units = [self._unit_of_block(name, late) for name in whole.blocks]
            sizes = self._part_of(whole.blocks, part, whole.late)
            scale = scale * np.repeat(units, [*sizes.values()])
            P[np.ix_(at, at)] = T * scale[:, None] * values[f"{c} P"] * scale
            places, factors = self._places(whole.rows, part, whole.late)
            for j, (i, x) in enumerate(zip(whole.late, late, strict=True)):
                width, own = len(self._S[i]), part.y[i]
                for name, matrix in terms[j].matrices.items():
                    value = values[f"{c} {j} {name}"]
                    # stacked maps have as many rows each as y, in the whole as in the part
                    count = matrix.shape[1] // width
                    across = (np.arange(count)[:, None] * width + own).ravel()
                    right = np.tile(self._units[i][own], count)
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

    def _places(self, rows: dict[str, int], part: _Part, late: list[int]) -> tuple[Indices, Array]:
        """Return where the rows of a part stand in the whole, and their units."""
        places, factors, start = [], [], 0
        for name, size in rows.items():
            own = self._entries(name, part, late)
            if name == "w":
                unit = np.ones(own.size)
            elif name == "p":
                unit = 1.0 / self._channel[own]
            elif name == "x":
                unit = self._back[own]
            else:
                time = self._T if name.startswith("r") else 1.0
                unit = time * self._units[late[_delay_of(name)]][own]
            places.append(start + own)
            factors.append(unit)
            start += size
        return np.concatenate(places).astype(np.intp), np.concatenate(factors)

    def _unit_of_block(self, name: str, late: list[LateAge]) -> float:
        """Return the unit of a block of y: 1 for a value, 1/time for an integral."""
        if name[0] in "xh":
            return 1.0
        x = late[_delay_of(name)]
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
