"""The proof with outages for `checker.py`: one functional in touch and out of touch.

The prover's outages.py derives the forms. Both are built here again from the closed and the open
loop.
"""
# mypy: ignore-errors
# ruff: noqa: ANN001, ANN201, B905, D103, N817, PLR0915

from fractions import Fraction as F

from . import arithmetic as sn

M, need, total = sn.M, sn.need, sn.total


def outages(s, table):
    keys = "alpha beta gamma rho fallback fallback_age P S R M eps eps_out"
    alpha, beta, gamma, rho, rows, age, P, S, R, cross, *eps = sn.values(table, keys)
    alpha, beta, rho = sn.text(alpha), sn.text(beta), [sn.text(x) for x in rho]
    gamma, eps = sn.scalar(gamma, needed=gamma is not None), [s.multipliers(x) for x in eps]
    positive = [j for j in range(1, len(s.d)) if s.d[j] > 0]
    fed = [j for j in positive if s.fed[j]]
    need(s.whole and len(fed) == 1 and not (s.open[fed[0]] or s.H[fed[0]]), "not one link")
    need(alpha > 0 and beta >= -alpha and 0 <= sn.number(age) <= s.d[fed[0]], "impossible rates")
    need(gamma is None or (gamma > 0 and s.q and s.p), "gamma bounds nothing")
    need(len(rho) == len(S) == len(R) == len(cross) == len(positive), "not one per positive delay")
    need(
        all(r > 0 and 1 / r >= sn.above_exp(2 * alpha * s.d[j]) for j, r in zip(positive, rho)),
        "rho",
    )
    K = sn.matrix(rows, s.m, s.n, sn.number)
    P, *both = (sn.symmetric(x, s.n) for x in (P, *S, *R))
    for A in (P, *both):
        sn.positive(A, s.n, "P, S or R")
    S, R = both[: len(positive)], both[len(positive) :]
    cross = [None if x is None else sn.matrix(x, s.n, s.n) for x in cross]
    for j, R_j, X in zip(positive, R, cross):
        need((X is not None) == bool(s.varies[j] or s.fed[j]), "M does not fit the delay")
        if X is not None:
            right = X.at(0, s.n)
            sn.positive(R_j + R_j.at(s.n, s.n) + right + right.T, 2 * s.n, "[R M; M' R]")
    for lost in (False, True):
        names = {j: f"x{j}" if X is not None else f"d{j}" for j, X in zip(positive, cross)}
        if lost and not age:
            names[fed[0]] = f"d{fed[0]}"
        sizes = [("x", s.n), *((name, s.n) for j in positive for name in {names[j]: 0, f"d{j}": 0})]
        o = sn.Form([*sizes, ("w", s.q * (gamma is not None)), ("p", s.s)])
        on = [o[names[i]] if i in names else o["x"] for i in range(len(s.d))]
        given = (s.open, [s.open_D, *(M() for _ in positive)]) if lost else (s.A, s.D)
        f, z, q = (total(A @ y for A, y in zip(each, on)) for each in (*given, s.H))
        acts_on = on[fed[0]] if age else o["x"]
        f = f + s.C @ o["w"] + s.E @ o["p"] + (s.B @ K @ acts_on if lost else M())
        z = z + s.D1 @ o["w"] + (s.D2 @ K @ acts_on if lost else M())
        o.add(o["x"], P @ f)
        o.square(o["x"], P, -2 * beta if lost else 2 * alpha)
        for j, r, S_j, R_j, X in zip(positive, rho, S, R, cross):
            x, now, end = o["x"], o[names[j]], o[f"d{j}"]
            o.square(x, S_j)
            o.square(end, S_j, -r)
            o.square(f, R_j, s.d[j] ** 2)
            again = lost and j == fed[0]
            o.square(x + -1 * now, R_j, -r * (s.d[j] / sn.number(age) if again and age else 1))
            o.square(now + -1 * end, R_j, -r)
            if X is not None and not again:
                o.add(x + -1 * now, X @ (now + -1 * end), -r)
        L_p, L_q = s.scalings(eps[lost])
        o.square(q, L_q)
        o.square(o["p"], L_p, -1)
        for y, weight in ((z, gamma and 1 / gamma), (o["w"], gamma and -gamma)):
            o.add(y, y, (weight or 0) / F(2))
        sn.positive(-1 * o.matrix, o.n, "-Phi out of touch" if lost else "-Phi in touch")
    share = beta / (alpha + beta) if beta > 0 else F(0)
    words = "in touch (every age of the feedback at most its d) V' <= -2 alpha V, out of touch (u "
    words += "= fallback x(t - o), 0 <= o <= fallback_age) V' <= 2 beta V, one V >= x'P x for both,"
    words += " and so V(T) <= V(0) exp(2 beta T_out - 2 alpha T_touch) with w = 0, whichever way "
    words += "the time is divided"
    gain = {} if gamma is None else {"gamma": str(gamma)}
    if gain:
        words += "; from x = 0 the integral over [0, T] of s z'z is at most gamma^2 times that of "
        words += "s w'w, s = exp(2 alpha T_touch - 2 beta T_out) up to each instant"
    rates = {"alpha": str(alpha), "beta": str(beta), "share": str(share)}
    return {"property": words, **rates, **gain, "fallback": rows, "fallback_age": age}
