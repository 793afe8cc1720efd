"""The LMI that designs a gain for ages as they are.

The functional is that of `ages_forms`. As in `bessel_legendre_lmi`, x' is kept as a row r, tied to
the loop by a multiplier (Finsler's lemma, the descriptor method of Fridman):

    2 (x + b r)'U (sum_i A_i x(t - tau_i) + B K x(t - tau_f) + C w + E p - r)

is added to V'. With every row x = X xh but those of w and p, U'X = I and Y = K X, the matrices of
the functional become ones of the same shape and signs, and the whole is linear in them, X (n, n;
not symmetric) and Y, with z, q by Schur complements and p = eh ph, eh = 1/eps, one for each block
of F:

    Phi + He (xh + b rh)'(sum_i A_i X xh_i + B Y xh_f + C w + eh E ph - X rh)
        + He z'(D X xh + D2 Y xh_f + D1 w) - gamma (w'w + z'z)
        + He h'(sum_i H_i X xh_i) - eh (h'h + ph'ph) < 0.

The scalar b [s], one multiplier for x and x' alike, is what is lost beside the analysis, which the
gain goes through next. Without parts: K may connect all states.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cosim.hinf.certificate import AgeFunctional, rows_of, state_blocks, unknowns_of
from cosim.hinf.lmi.ages_forms import Form, LateAge, PartOfLoop, count_of
from cosim.hinf.lmi.conic import Constraint
from cosim.hinf.lmi.loop_lmi import Constraints, GainLmi
from cosim.hinf.lmi.svec import Array, svec
from cosim.models import DelaySystem


class AgesSynthesisLmi(GainLmi[float]):
    """The LMI of one system at one order; its multiplier is b [s].

    Parameters
    ----------
    system : Eq. (7), with a positive delay.
    order : N.
    functionals : by delay, of those that hold for it.
    K : (m, n) a gain of about the expected size: it sets the units.
    reference : a gamma of about the expected size; None for stability alone.
    """

    def __init__(
        self,
        system: DelaySystem,
        order: int,
        functionals: Sequence[AgeFunctional],
        K: Array,
        reference: float | None,
    ) -> None:
        super().__init__(system, K, reference)
        late = [
            LateAge(i, own, x.d / self._T, x.least_age / self._T, x.rate or 0.0)
            for i, (own, x) in enumerate(zip(functionals, system.delays, strict=True))
            if x.d > 0
        ]
        self._places = {x.index: f"x{j}" for j, x in enumerate(late)}
        own = tuple(x.functional for x in late)
        performance = reference is not None
        rows = rows_of(system, order, own, gamma=performance) | {"r": len(self._back)}
        rows |= {"z": system.D.shape[0]} if performance else {}
        rows |= {"h": system.H.shape[0]} if system.E.size else {}
        blocks = state_blocks(system, order, own)
        self._forms = PartOfLoop(
            0, order, late, {"S": [np.eye(len(self._back))] * len(system.delays)}, rows, blocks
        )
        n, m = self._B.shape
        shapes = {"gain X": (n, n), "gain Y": (m, n), "0 P": (sum(blocks.values()),) * 2}
        for j, names in enumerate(unknowns_of(system, order, own, gamma=performance)):
            for name, (height, width) in names.items():
                shapes[f"0 {j} {name}"] = (sum(rows.values()) if name == "Y" else height, width)
        shapes |= dict.fromkeys(self._blocks, (1, 1))
        self._at, self._width = {}, 0
        for name, shape in shapes.items():
            self._at[name] = slice(self._width, self._width + count_of(name, shape))
            self._width = self._at[name].stop

    @property
    def rows(self) -> int:
        """Rows of Phi at the corner that has most."""
        return max(int(self._forms.rows_at(c)["x"].shape[1]) for c in self._forms.corners())

    def _constraints(self, multiplier: float, gamma: float | None) -> Constraints:
        b = multiplier
        width = self._width + (gamma is None)
        phi = []
        for corner in self._forms.corners():
            at = self._forms.rows_at(corner)
            form = Form(at["x"].shape[1])
            self._forms.add_functional(form, at, at["r"], corner)
            self._tie(form, at, at["x"] + b / self._T * at["r"])
            own = form.constraint(self._at, width)
            whole = Constraint(own.size, -own.constant, -own.columns)
            if "z" in at:
                supplied = svec(at["w"].T @ at["w"] + at["z"].T @ at["z"])
                if gamma is None:
                    whole.columns[:, -1] += supplied
                else:
                    share = gamma / (self._reference or 1.0)
                    whole = Constraint(own.size, whole.constant + share * supplied, whole.columns)
            phi.append(whole)
        positive = [form.constraint(self._at, width) for form in self._forms.positive()]
        for name in self._blocks:
            one = Form(1)
            one.multiple(name, np.eye(1))
            positive.append(one.constraint(self._at, width))
        return phi, positive

    def _tie(self, form: Form, at: dict[str, Array], M: Array) -> None:
        """Add the loop, z and q."""
        on = [at["x"], *(at[self._places.get(i, "x")] for i in range(len(self._A) - 1))]
        acting = next(x for x, acts in zip(on, self._acts, strict=True) if acts)
        for A, x in zip(self._A, on, strict=True):
            form.twice("gain X", A.T @ M, x)
        form.twice("gain X", M, at["r"], -1.0)
        form.twice("gain Y", self._B.T @ M, acting)

        def symmetrised(left: Array, right: Array) -> Array:
            half = left.T @ right
            return half + half.T

        if "h" in at:
            p, h = at["p"], at["h"]
            for name, (columns, rows) in self._blocks.items():
                own, q = p[columns], h[rows]
                f = symmetrised(M, self._E[:, columns] @ own)
                form.multiple(name, f - own.T @ own - q.T @ q)
            for H, x in zip(self._H, on, strict=True):
                form.twice("gain X", H.T @ h, x)
        if "z" in at:
            w, z = at["w"], at["z"]
            form.constant = symmetrised(M, self._C @ w) + symmetrised(z, self._D1 @ w)
            form.twice("gain X", self._D.T @ z, at["x"])
            form.twice("gain Y", self._D2.T @ z, acting)
