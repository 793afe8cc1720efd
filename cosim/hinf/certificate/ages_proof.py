"""The proof, in rational arithmetic, of what a given gain guarantees where the ages are known.

The loop is x' = f = sum_i A_i x(t - tau_i) + C w + E p for u = K x(t - tau_f), as in
`analysis_proof`: doubles taken exactly, delays of zero folded into x(t). V is y'P y plus the
terms of each positive delay (`ages_terms`); docs/explanation/theory.md derives them and gives the
sources.
With a = least_age, N the order, c = (333/106)^2/4 < pi^2/4, |v|_R^2 = v'R v, He M = M + M':

    over a constant part of length l, from x(t) to x(t - l) (l = d for a constant delay, else a):
        Q, R and l W_k in y, k < N, as in `analysis_proof`
    interval, with l = d - a:
        + |x_a|_S^2 - |x_d|_S^2 + l^2 |f|_Z^2 - [v; u]'[Zh M; M' Zh][v; u],
        v = (x_a - x_tau; x_a + x_tau - 2 m_1), u = (x_tau - x_d; x_tau + x_d - 2 m_2),
        Zh = diag(Z, 3 Z), and (tau - a) m_1 + (d - tau) m_2 in y;
        at order 0 only the first rows of v and u, and nothing in y
    rate: the same, with |x_a|_S1^2 - (1 - tau')|x_tau|_(S1 - S2)^2 - |x_d|_S2^2 in place of S,
        and (tau - a) m_1, (d - tau) m_2 in y, one by one
    wirtinger, with l = d - a:  + l^2 |f|_W^2 - c |x_a - x_tau|_W^2
    looped, with l = d - a, xi all rows, z = (x - x_t; x_a - x_k), z_0 = (x_t; x_k),
        z' = (f; x'_a), x_k = x_tau = x(s_k), x_t = x(s_k + a):
        + |f|_N^2 - |x'_a|_N^2 - z'X_a z - He(z'X_b z_0) - He(xi'Y z), x_a in y, and, at the
        start of a hold (age a), l (|z'|_U^2 + He z''(X_a z + X_b z_0)), at its end (age d)
        l He(xi'Y v) - l |v|_U^2 in further rows v; where a = 0: z = x - x_k, z_0 = x_k, no N

A delay with a support (`ages_terms.Support`) has its terms in y = C x in place of x, from
A_i + B K S_i = A' C, H_i = H' C and D2 K S_i = D' C, with C exact: x_a, x_tau, x_d, W_k, m_1, ..
are those of y, and the rate of y is C f.

Where constant delays are covered down to zero, l of each is d and 0 at the corners: y is affine
in l, and Phi but for the convex l^2 |f|_R^2. Phi, with eps (q'q - p'p) + z'z/gamma
- gamma w'w, is affine in every tau, tau' and time since an instant, so that -Phi > 0 is shown
at every corner. Beside it, > 0:

    Q, R, S, S_1, S_2, Z, W, N and gamma, [Zh M; M' Zh],
    P + diag(0, (2k+1)/l Q, S/l), and this with |x - x_a|_N^2/a + l (z'X_a z + He z'X_b z_0)
    + |z|_U^2 added for any of the looped delays, in [y; x_t; x_k]: V > 0 at every time.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import flint

from cosim.hinf.certificate.ages_terms import (
    AgesVariables,
    Support,
    check_functionals,
    check_supports,
    late_delays,
    rows_of,
    state_blocks,
    widths_of,
)
from cosim.hinf.certificate.analysis_proof import EXACTLY, ExactLoop, exact_loop, orders_of
from cosim.hinf.certificate.block_multipliers import scalings
from cosim.hinf.certificate.proof import CertificateCheck, claim_of, require_size
from cosim.hinf.certificate.quadratic_form import Form, Map, cut
from cosim.hinf.certificate.rational import (
    exact,
    exact_matrix,
    first_bad_matrix,
    identity,
)
from cosim.hinf.certificate.theorem import uncertainty_text

if TYPE_CHECKING:
    from cosim.models import Delay, DelaySystem, Matrix

MAX_CORNERS = 64
"""Most corners at which -Phi is shown: two or four for each delay whose age varies."""

_PI_LOWER = flint.fmpq(333, 106)  # a convergent of pi from below; 22/7 and 355/113 lie above it


def ages_claim(system: DelaySystem, v: AgesVariables) -> dict[str, Any]:
    """Return the claim of a certificate: as `claim_of`, with the ages and all hypotheses."""
    claim = claim_of(system, v.gamma)
    measured = _OF_ENTRIES if system.has_masks else _FEEDBACK[system.is_structured]
    own = iter(v.functionals)
    for delay_claim, delay in zip(claim["delays"], system.delays, strict=True):
        if delay.d > 0:
            delay_claim.update(_age_claim(delay, next(own), exactly=_exactly(v)))
    return claim | {"order": v.order, "hypotheses": _hypotheses(v, measured, claim)}


def _exactly(v: AgesVariables) -> bool:
    """Whether the claim is about exactly the constant delays."""
    return v.order > 0 and not v.down_to_zero


def _age_claim(delay: Delay, functional: str, *, exactly: bool) -> dict[str, Any]:
    """Return the part of the claim that says how an age varies; numbers are doubles, as d is."""
    if functional == "constant":
        return {"age": EXACTLY if exactly else "constant, up to d"}
    least = {"least_age": delay.least_age}
    if functional == "interval":
        if delay.least_age == 0:
            return {"age": "any, however it varies, up to d"}
        return least | {"age": "any, however it varies, from least_age to d"}
    if functional == "rate":
        return least | {"age": "from least_age to d, |age'| <= rate", "rate": delay.rate}
    return least | {"age": "sampled: from least_age at rate one to d at most"}


_FEEDBACK = {
    False: "u = K x(t - age_f(t)): the whole state is measured",
    True: "u = K sum_i S_i x(t - age_i(t)), S_i the diagonal of the truth values of feedback",
}
"""What is measured, by whether the feedback is of single states."""

_OF_ENTRIES = "u = sum_i (K o M_i) x(t - age_i(t)), M_i the truth values of feedback by entry of K"


def _hypotheses(v: AgesVariables, measured: str, claim: dict[str, Any]) -> list[str]:
    """Return what the theorem asks for, sentence by sentence."""
    texts = [
        "x' = sum_i (A_i + dA_i) x(t - age_i(t)) + B u + C w for almost every t >= 0",
        measured,
        "every age is a measurable function of time",
        "stability: w = 0 and any continuous initial function on [-max d, 0]",
    ]
    if v.gamma is not None:
        texts.append(
            "gain: x = 0 for t <= 0, w square integrable on [0, T], and then the integral of z'z "
            "over [0, T] is at most gamma^2 times that of w'w, for every T > 0"
        )
    if claim["uncertain"]:
        texts.append(f"uncertainty: {uncertainty_text(claim)}")
    if any(own == "rate" for own in v.functionals):
        texts.append("an age with a bounded rate is Lipschitz continuous")
    if any(own in {"wirtinger", "looped"} for own in v.functionals):
        texts.append(
            "a sampled age, a = least_age: x(t - age) = x(s_k) for s_k + a <= t < s_(k+1) + a, "
            "0 < s_(k+1) - s_k <= d - a, s_0 + a <= 0, finitely many s_k in any bounded time"
        )
    return texts


def ages_proved(system: DelaySystem, gain: Matrix, v: AgesVariables) -> CertificateCheck:
    """Prove the claim of `ages_claim` for u = K x(t - age_f), or return why it is not proved.

    Parameters
    ----------
    system : its doubles are taken exactly.
    gain : (m, n) K, its doubles taken exactly.
    v : symmetric matrices, M, X_b, Y and numbers that fit the system, as rationals.

    Raises
    ------
    InputError : more than `MAX_ROWS` rows or `MAX_CORNERS` corners, or a functional or a support
        that does not hold for a delay.
    """
    reason = _failure(system, gain, v)
    return CertificateCheck(valid=reason is None, reason=reason, claim=ages_claim(system, v))


def _failure(system: DelaySystem, gain: Matrix, v: AgesVariables) -> str | None:
    check_functionals(system, v.functionals)
    check_supports(system, gain, v.supports)
    rows = sum(_rows(system, v).values())
    rows += sum(own.matrices["U"].nrows() for own in v.terms if own.functional == "looped")
    corners = corners_of(system, v)
    require_size(rows)
    require_size(len(corners), MAX_CORNERS, "corners")
    if v.gamma is not None and not v.gamma > 0:
        return "gamma is not positive"
    name = first_bad_matrix(
        (f"{name}[{j}]", own.matrices[name])
        for j, own in enumerate(v.terms)
        for name in ("Q", "R", "S", "S_1", "S_2", "Z", "W", "N")
        if name in own.matrices
    )
    if name is not None:
        return f"{name} is not positive definite"
    proof = _Forms(system, gain, v)
    of_phi = ((f"-Phi at {_corner_text(at)}", proof.minus_phi(at)) for at in corners)
    for name, form in (*proof.positive(), *of_phi):
        reason = form.failure(name)
        if reason is not None:
            return reason
    return None


def _rows(system: DelaySystem, v: AgesVariables) -> dict[str, int]:
    return rows_of(system, v.order, v.functionals, gamma=v.gamma is not None, supports=v.supports)


def _on_supports(
    system: DelaySystem, gain: Matrix, loop: ExactLoop, supports: tuple[Support | None, ...]
) -> tuple[ExactLoop, list[Any]]:
    """Return the loop with A', H', D' of every delay with a support, and C of every delay."""
    n = len(system.A)
    A, H, D, C = loop.A[:1], loop.H[:1], loop.D[:1], []
    late = [S for x, S in zip(system.delays, system.selections[1:], strict=True) if x.d > 0]
    for j, (own, selection) in enumerate(zip(supports, late, strict=True), 1):
        if own is not None and own.of == "controls":
            rows = list(own.numbers)
            C.append(exact_matrix((gain * selection)[rows]))
            A.append(exact_matrix(system.B[:, rows]))
            H.append(flint.fmpq_mat(loop.H[j].nrows(), len(rows)))
            D.append(exact_matrix(system.D2[:, rows]))
            continue
        select = identity(n)
        if own is not None:
            entries = [int(i == k) for i in own.numbers for k in range(n)]
            select = flint.fmpq_mat(len(own.numbers), n, entries)
        C.append(select)
        for each, whole in ((A, loop.A[j]), (H, loop.H[j]), (D, loop.D[j])):
            each.append(whole if own is None else whole * select.transpose())
    return replace(loop, A=A, H=H, D=D), C


def corners_of(system: DelaySystem, v: AgesVariables) -> list[tuple[Any, ...]]:
    """Return the corners: per positive delay None, (age,), or (age, its rate)."""
    zero = exact(0.0)
    ends: list[list[Any]] = []
    for own, delay in zip(v.functionals, late_delays(system), strict=True):
        ages: list[Any] = [(exact(delay.least_age),), (exact(delay.d),)]
        rate = exact(delay.rate or 0.0)
        if own == "rate":
            reached = ages if v.order else ages[:1]  # at order 0 nothing depends on the age
            ends.append([(*age, slope) for age in reached for slope in sorted({-rate, rate})])
        elif own == "looped" or (own == "interval" and v.order):
            ends.append(ages)
        elif own == "constant" and v.order and v.down_to_zero:
            ends.append([(exact(delay.d),), (zero,)])
        else:
            ends.append([None])
    return list(itertools.product(*ends))


def _corner_text(corner: tuple[Any, ...]) -> str:
    texts = [
        f"age {float(at[0]):g}" + (f" and rate {float(at[1]):g}" if len(at) > 1 else "")
        for at in corner
        if at is not None
    ]
    return ", ".join(texts) or "its only corner"


class _Forms:
    """The forms of one loop that must be positive, from the equations of the module."""

    def __init__(self, system: DelaySystem, gain: Matrix, v: AgesVariables) -> None:
        loop = exact_loop(system, gain, orders_of(system, v.order))
        self._loop, self._C = _on_supports(system, gain, loop, v.supports)
        self._v = v
        self._late, self._width = late_delays(system), widths_of(system, v.supports)
        self._rows = _rows(system, v)
        self._state = state_blocks(system, v.order, v.functionals, v.supports)

    def minus_phi(  # noqa: C901 - one table, read from top to bottom
        self, corner: tuple[Any, ...]
    ) -> Form:
        """Return -Phi at a corner of `corners_of`."""
        v, loop = self._v, self._loop
        sizes = dict(self._rows)
        for j, (own, at) in enumerate(zip(v.terms, corner, strict=True)):
            if own.functional == "looped" and at[0] == exact(self._late[j].d):
                count = own.matrices["U"].nrows() // self._width[j]
                sizes |= {f"v{j},{i}": self._width[j] for i in range(count)}
        form = Form(sizes)
        on = ["x", *(f"x{j}" for j in range(len(self._late)))]
        f = dict(zip(on, loop.A, strict=True))
        if v.gamma is not None:
            f["w"] = loop.C
        if loop.blocks:
            f["p"] = loop.E
        state: list[tuple[Map, Map]] = [({"x": identity(sizes["x"])}, f)]
        for j, (own, at) in enumerate(zip(v.terms, corner, strict=True)):
            delay = self._late[j]
            rate = {name: self._C[j] * M for name, M in f.items()}
            if own.functional == "constant":
                length = exact(delay.d) if at is None else at[0]
                state += self._constant_part(form, j, rate, f"x{j}", length)
            elif delay.least_age > 0:
                state += self._constant_part(form, j, rate, f"h{j}", exact(delay.least_age))
            if own.functional in {"interval", "rate"}:
                state += self._between(form, j, rate, at)
            elif own.functional == "wirtinger":
                length = exact(delay.d) - exact(delay.least_age)
                W = own.matrices["W"]
                form.square(rate, -length * length * W)
                form.square(self._minus(j, self._start(j), f"x{j}"), _PI_LOWER**2 / 4 * W)
            elif own.functional == "looped":
                state += self._looped(form, j, rate, at[0])
        values, rates = [value for value, _ in state], [rate for _, rate in state]
        form.twice_of(values, -v.P, rates)
        if loop.blocks:
            L_p, L_q = scalings(loop.blocks, v.eps)
            form.square(dict(zip(on, loop.H, strict=True)), -L_q)
            form.square({"p": identity(sizes["p"])}, L_p)
        if v.gamma is not None:
            z = dict(zip(on, loop.D, strict=True)) | {"w": loop.D1}
            form.square(z, -1 / v.gamma * identity(loop.D1.nrows()))
            form.square({"w": identity(sizes["w"])}, v.gamma * identity(sizes["w"]))
        return form

    def positive(self) -> list[tuple[str, Form]]:
        """Return the other forms, with their names."""
        found = []
        for j, own in enumerate(self._v.terms):
            if own.functional not in {"interval", "rate"}:
                continue
            width = self._width[j]
            count = own.matrices["M"].nrows() // width
            names = [f"{side}{i}" for side in "vu" for i in range(count)]
            form = Form(dict.fromkeys(names, width))
            maps = [{name: identity(width)} for name in names]
            for i, each in enumerate(maps):
                form.square(each, (2 * (i % count) + 1) * own.matrices["Z"])
            form.twice_of(maps[:count], own.matrices["M"], maps[count:])
            found.append((f"[Z M[{j}]; M' Z]", form))
        looped = [j for j, own in enumerate(self._v.terms) if own.functional == "looped"]
        for count in range(len(looped) + 1):
            for sampled in itertools.combinations(looped, count):
                at = (
                    f", with what X_a, X_b add of {', '.join(map(str, sampled))},"
                    if sampled
                    else ","
                )
                found.append((f"P, with what Q and S add to it{at}", self._functional(sampled)))
        return found

    def _functional(self, sampled: tuple[int, ...]) -> Form:
        """P + ... at the start of a hold of the delays `sampled`."""
        sizes = dict(self._state)
        for j in sampled:
            names = [f"t{j}"] if self._late[j].least_age > 0 else []
            sizes |= dict.fromkeys([*names, f"x{j}"], self._width[j])
        form = Form(sizes)
        form.square_of([{name: identity(n)} for name, n in self._state.items()], self._v.P)
        for j, (own, delay) in enumerate(zip(self._v.terms, self._late, strict=True)):
            least = exact(delay.d if own.functional == "constant" else delay.least_age)
            length = exact(delay.d) - exact(delay.least_age)
            one = identity(self._width[j])
            for name in self._state:
                if name.startswith(f"W{j},"):
                    k = int(name.split(",")[1])
                    form.square({name: one}, (2 * k + 1) / least * own.matrices["Q"])
            for name, Q in ((f"ab{j}", "S"), (f"a{j}", "S_1"), (f"b{j}", "S_2")):
                if name in self._state:
                    form.square({name: one}, 1 / length * own.matrices[Q])
            if j not in sampled:
                continue
            z, start = self._loop_maps(j)
            if delay.least_age > 0:
                form.square(self._minus(j, "x", f"h{j}"), 1 / least * own.matrices["N"])
            form.square_of(z, length * own.matrices["X_a"] + own.matrices["U"])
            form.twice_of(z, length * own.matrices["X_b"], start)
        return form

    def _start(self, j: int) -> str:
        """The row of y(t - least_age)."""
        return f"h{j}" if self._late[j].least_age > 0 else "x"

    def _y(self, j: int, name: str, factor: int = 1) -> Map:
        """Return y_j as a map: C x(t), or a row of its own."""
        return {name: factor * (self._C[j] if name == "x" else identity(self._width[j]))}

    def _minus(self, j: int, first: str, second: str) -> Map:
        return self._y(j, first) | self._y(j, second, -1)

    def _constant_part(
        self, form: Form, j: int, f: Map, end: str, length: Any
    ) -> list[tuple[Map, Map]]:
        """Subtract the terms of Q and R; return the blocks l W_k of y with their derivatives."""
        one, own = identity(self._width[j]), self._v.terms[j].matrices
        form.square(self._y(j, "x"), -own["Q"])
        form.square({end: one}, own["Q"])
        form.square(f, -length * length * own["R"])
        state = []
        for k in range(self._v.order + 1):
            # the integral of L_k y' over the part, by parts
            change = self._y(j, "x") | self._y(j, end, (-1) ** (k + 1))
            for i in range(k):
                if (k + i) % 2:
                    change[f"W{j},{i}"] = -2 * (2 * i + 1) * one
            form.square(change, (2 * k + 1) * own["R"])
            if k < self._v.order:
                state.append(({f"W{j},{k}": length * one}, change))
        return state

    def _between(self, form: Form, j: int, f: Map, at: Any) -> list[tuple[Map, Map]]:
        """Subtract the terms of an age between two bounds; return its blocks of y."""
        own, delay = self._v.terms[j].matrices, self._late[j]
        one, first, last = identity(self._width[j]), exact(delay.least_age), exact(delay.d)
        now, end = f"x{j}", f"d{j}"
        start = self._y(j, self._start(j))
        young, old = [start | {now: -one}], [self._minus(j, now, end)]
        if self._v.order:
            young.append(start | {now: one, f"a{j}": -2 * one})
            old.append({now: one, end: one, f"b{j}": -2 * one})
        form.square(f, -((last - first) ** 2) * own["Z"])
        for k, pair in enumerate(zip(young, old, strict=True)):
            for change in pair:
                form.square(change, (2 * k + 1) * own["Z"])
        form.twice_of(young, own["M"], old)
        if self._v.terms[j].functional == "interval":
            form.square(start, -own["S"])
            form.square({end: one}, own["S"])
            if not self._v.order:
                return []
            age = at[0]
            mean: Map = {f"a{j}": (age - first) * one, f"b{j}": (last - age) * one}
            return [(mean, start | {end: -one})]
        slope = 1 - at[1]
        form.square(start, -own["S_1"])
        form.square({now: one}, slope * (own["S_1"] - own["S_2"]))
        form.square({end: one}, own["S_2"])
        if not self._v.order:
            return []
        return [
            ({f"a{j}": (at[0] - first) * one}, start | {now: -slope * one}),
            ({f"b{j}": (last - at[0]) * one}, {now: slope * one, end: -one}),
        ]

    def _loop_maps(self, j: int) -> tuple[list[Map], list[Map]]:
        """z and z_0 of a looped functional, each a list of maps."""
        if self._late[j].least_age > 0:
            z = [self._minus(j, "x", f"t{j}"), self._minus(j, f"h{j}", f"x{j}")]
            return z, [self._y(j, f"t{j}"), self._y(j, f"x{j}")]
        return [self._minus(j, "x", f"x{j}")], [self._y(j, f"x{j}")]

    def _looped(self, form: Form, j: int, f: Map, age: Any) -> list[tuple[Map, Map]]:
        """Subtract the terms of a looped functional; return its block of y."""
        own, delay, width = self._v.terms[j].matrices, self._late[j], self._width[j]
        length = exact(delay.d) - exact(delay.least_age)
        z, start = self._loop_maps(j)
        rate, state = [f], []
        if delay.least_age > 0:
            late_rate = self._y(j, f"r{j}")
            form.square(f, -own["N"])
            form.square(late_rate, own["N"])
            rate.append(late_rate)
            state.append((self._y(j, f"h{j}"), late_rate))
        form.square_of(z, own["X_a"])
        form.twice_of(z, own["X_b"], start)
        further = [self._y(j, f"v{j},{i}") for i in range(len(z))]
        first = 0
        for name, size in self._rows.items():
            for i, (each, more) in enumerate(zip(z, further, strict=True)):
                Y = cut(own["Y"], first, i * width, size, width)
                form.twice({name: identity(size)}, Y, each)
                if age == exact(delay.d):
                    form.twice({name: identity(size)}, -length * Y, more)
            first += size
        if age == exact(delay.d):
            form.square_of(further, length * own["U"])
        else:
            form.square_of(rate, -length * own["U"])
            form.twice_of(rate, -length * own["X_a"], z)
            form.twice_of(rate, -length * own["X_b"], start)
        return state
