"""Check a certificate: Theorem 2, the guarantees beside it, refutations, and what others prove.

theorems/theorem_2.py derives Theorem 2, decay.py and control_limits.py the guarantees,
refutation_proof.py refutations, docs/explanation/theory.md the functionals of an analysis.
"""
# mypy: ignore-errors
# ruff: noqa: ANN001, ANN201, ANN202, B905, D103, FBT002, N817

from copy import copy
from fractions import Fraction as F
from itertools import product

from . import arithmetic as sn
from .analysis import analysis_proved
from .damping import damped
from .outages import outages
from .pair import need_pair, observer_claim

M, need, total = sn.M, sn.need, sn.total

UP_TO, ANY = "constant, up to d", "any, however it varies, up to d"


def claim_of(s, gamma):
    each = zip(s.d[1:], s.varies[1:], s.fed[1:])
    claim = {
        "property": "stability" if gamma is None else "stability and H-infinity gain <= gamma",
        "gamma": None if gamma is None else str(gamma),
        "delays": [
            {"d": d, "age": ANY if varies else UP_TO, "feedback": fed} for d, varies, fed in each
        ],
        "uncertain": s.s > 0,
        "inputs": "doubles",
    }
    claim |= {"uncertainty_blocks": [[*pair] for pair in s.blocks]} if len(s.blocks) > 1 else {}
    return claim | ({"feedback": s.fed[0]} if isinstance(s.fed[0], list) else {})


def variables_of(s, table, gain):
    X, Q, R, eps, k1, k2, gamma = sn.values(table, "X Q R eps k1 k2 gamma", "Y")
    need(all(len(x) == len(s.delays) for x in (Q, R, k1, k2)), "not one of each per delay")
    Q, R = ([sn.symmetric(x, s.n) for x in each] for each in (Q, R))
    k1, k2 = ([sn.text(x) for x in each] for each in (k1, k2))
    eps, gamma = s.multipliers(eps), sn.scalar(gamma, needed=gain)
    return sn.symmetric(X, s.n), Q, R, eps, k1, k2, gamma


def omega(s, loop, X, Q, R, eps, k1, k2, gamma, z=True, rate=0):
    """Omega of Theorem 2 without its rows m_j (Schur complement); loop: G_i, Z_i, H_i X."""
    delays = range(1, len(s.d))
    rows = [(f"x{i}", s.n) for i in range(len(s.d))]
    rows += [("w", s.q), ("z", s.p * z)] if gamma is not None else []
    o = sn.Form([*rows, *((f"r{j}", s.n) for j in delays if s.d[j]), ("h", s.r)])
    x = [o[f"x{i}"] for i in range(len(s.d))]
    f, out, h = (total(A @ y for A, y in zip(each, x)) for each in loop)
    f = f + s.C @ o["w"] + rate * X @ x[0]
    o.add(x[0], f)
    o.add(o["z"], out + s.D1 @ o["w"])
    o.add(o["h"], h)
    e, (L_p, L_q) = s.E.T @ (x[0] + total(s.d[j] * o[f"r{j}"] for j in delays)), s.scalings(eps)
    o.square(e, L_p)
    o.square(o["h"], L_q, -1)
    for y in (o["w"], o["z"]):
        o.add(y, y, -(gamma or 0) / F(2))
    for j, Q_j, R_j, one, two in zip(delays, Q, R, k1, k2):
        slack, r, d = one * x[0] + two * x[j], o[f"r{j}"], s.d[j]
        o.square(x[0], Q_j)
        o.square(x[j], Q_j, -1)
        o.add(slack, X @ (x[0] + -1 * x[j]))
        o.square(slack, R_j, d)
        o.add(r, f, d)
        o.square(r, R_j, -d)
    return o


def theorem_2(s, X, Q, R, eps, k1, k2, gamma, z=True, rate=0, growth=None):
    """X > 0, Q > 0 (0 where any age is allowed), R > 0, k2 /= 0 and -Omega > 0 for Y = K X."""
    need(s.whole and all(k2), "k2 is 0, or the state is not fed back as a whole")
    sn.positive(X, s.n, "X")
    for j, (Q_j, R_j) in enumerate(zip(Q, R), 1):
        need(not s.varies[j] or not Q_j, "Q is not 0 where any age is allowed")
        for name, A in (("R", R_j), *([] if s.varies[j] else [("Q", Q_j)])):
            sn.positive(A, s.n, name)
    growth = [1, *(growth or [1] * len(Q))]
    G, H = ([c * A @ X for c, A in zip(growth, each)] for each in (s.A, s.H))
    o = omega(s, (G, [D @ X for D in s.D], H), X, Q, R, eps, k1, k2, gamma, z, rate)
    sn.positive(-1 * o.matrix, o.n, "-Omega")


def design(c, s):
    v = variables_of(s, c["variables"], s.q and s.p)
    need(s.K @ v[0] == sn.matrix(c["variables"]["Y"], s.m, s.n), "Y is not K X")
    theorem_2(s, *v)
    return claim_of(s, v[-1]) | guarantees(c, s)


def guarantees(c, s):
    readers = {"decay": decay, "damping": damping, "gain_limit": gain_limit}
    readers |= {"peak_control": peak_control, "state_peaks": state_peaks, "outages": outages}
    more = {name: readers[name](s, table) for name, table in c.get("guarantees", {}).items()}
    return {"guarantees": more} if more else {}


def decay(s, table):
    rate, growth, v = sn.values(table, "rate growth variables")
    rate, growth, v = sn.text(rate), [sn.text(x) for x in growth], variables_of(s, v, gain=False)
    need(rate > 0 and len(growth) == len(s.delays), "no rate, or not one growth per delay")
    ends = []
    for j, end in enumerate(growth, 1):
        acts = s.d[j] > 0 and (s.open[j] or s.H[j] or (s.fed[j] and s.B))
        need(not acts or end >= sn.above_exp(rate * s.d[j]), "growth is below exp(rate d)")
        ends.append((1, end) if acts else (1,))
    for corner in product(*ends):
        theorem_2(s, *v, rate=rate, growth=corner)
    words = "every solution with w = 0 decays at least as exp(-rate t)"
    return {"property": words, "rate": str(rate)}


def damping(s, table):
    ratio, within = (sn.text(x) for x in sn.values(table, "ratio within"))
    damped(s, ratio, within)
    words = "nominal loop (F = 0, every age constant, exactly d): every characteristic root s with "
    words += "Re s >= -within has a damping ratio -Re s / |s| > ratio"
    return {"property": words, "ratio": str(ratio), "within": str(within)}


def gain_limit(s, table):
    bound = sn.text(*sn.values(table, "bound"))
    need(bound >= 0, "the bound is negative")
    sn.positive(bound**2 * sn.eye(s.m) + -1 * s.K @ s.K.T, s.m, "bound^2 - K K'")
    return {"property": "the largest singular value of K is at most bound", "bound": str(bound)}


def peak_control(s, table):
    bounds, offset, energy, v = sn.values(table, "bounds offset energy variables")
    bounds, offset, energy = [[sn.text(x) for x in each] for each in (bounds, offset, [energy])]
    need(min(bounds + offset + energy) >= 0, "a bound, an offset or the energy is negative")
    need((len(bounds), len(offset)) == (s.m, s.n) and (s.q or not energy[0]), "a wrong length")
    need(sum(x > 0 for x in offset) <= 8, "too many corners")
    X, Q, *v = variables_of(s, v, energy[0])
    theorem_2(s, X, Q, *v, z=False)
    P = inverse(X, s.n)
    P = P @ (X + total(d * A for d, A in zip(s.d[1:], Q))) @ P
    starts = product(*((x, -x)[: 1 + (x > 0)] for x in offset))
    columns = [M({(i, 0): x for i, x in enumerate(start)}) for start in starts]
    level = max((x.T @ P @ x).get((0, 0), 0) for x in columns) + (v[-1] or 0) * energy[0] ** 2
    KXK = s.K @ X @ s.K.T
    need(all(x**2 >= level * KXK.get((i, i), 0) for i, x in enumerate(bounds)), "bounds too low")
    words = "|u_i(t)| <= bounds_i for every t, from any constant initial state with |x_i| <= "
    words += "offset_i, with any w of int w'w <= energy^2"
    texts = [str(x) for x in bounds], [str(x) for x in offset], str(energy[0])
    return {"property": words, **dict(zip(("bounds", "offset", "energy"), texts))}


def state_peaks(s, table):
    rows, starts, bounds, energy, v = sn.values(table, "rows starts bounds energy variables")
    k, energy, bounds = len(starts[0]), sn.text(energy), [sn.text(x) for x in bounds]
    G, S = sn.matrix(rows, len(bounds), s.n, sn.number), sn.matrix(starts, s.n, k, sn.number)
    need(k <= 8 and min([*bounds, energy]) >= 0, "too many corners, or a negative number")
    bare = copy(s)
    bare.D, bare.D1 = [M() for _ in s.D], M()
    bare.p = s.p or 1
    gamma, _, more = analysis_proved({"kind": "analysis", "variables": v}, bare)
    need(more == {"order": 0} and (gamma is None) == (energy == 0), "not order 0, or no mu")
    P, weights = sn.symmetric(v["P"], s.n), sn.symmetric(v["P"], s.n)
    for d, Q in zip([d for d in s.d[1:] if d > 0], v["Q"], strict=True):
        weights = weights + (M() if Q is None else d * sn.symmetric(Q, s.n))
    columns = [S @ M({(i, 0): F(x) for i, x in enumerate(a)}) for a in product((1, -1), repeat=k)]
    level = max((x.T @ weights @ x).get((0, 0), 0) for x in columns) + (gamma or 0) * energy**2
    of_energy = G @ inverse(P, s.n) @ G.T
    need(
        all(x**2 >= level * of_energy.get((i, i), 0) for i, x in enumerate(bounds)),
        "bounds too low",
    )
    words = (
        "|g_i x(t)| <= bounds_i for every t >= 0, g_i the rows, from any constant initial state "
    )
    words += "sum_k a_k s_k, |a_k| <= 1, s_k the columns of starts, with any w of int w'w <= "
    texts = {"bounds": [str(x) for x in bounds], "energy": str(energy)}
    return {"property": words + "energy^2", "rows": rows, "starts": starts, **texts}


def inverse(A, n):
    """A^-1 for A > 0, by elimination."""
    B = sn.eye(n)
    for k in range(n):
        column = M({(i, 0): A.get((i, k), 0) - (i == k) for i in range(n)})
        rows = [M({(0, j): x / A[k, k] for (i, j), x in e.items() if i == k}) for e in (A, B)]
        A, B = (each + -1 * column @ row for each, row in zip((A, B), rows))
    return B


def refutation(c, s):
    """Farkas: multipliers > 0 that cancel every unknown of Omega and leave nothing positive."""
    n, places, none = s.n, range(1, len(s.d)), M()
    k1, k2, gamma = sn.values(c["at"], "k1 k2 gamma")
    (k1, k2), gamma = (
        [[sn.text(x) for x in each] for each in (k1, k2)],
        sn.scalar(gamma, needed=s.q and s.p),
    )
    Z, X, Q = sn.values(c["multipliers"], "Z X Q")
    need(
        s.whole and len(k1) == len(k2) == len(Q) == len(s.delays) and all(k2), "no k2, or a length"
    )
    need([x is None for x in Q] == s.varies[1:], "a multiplier Q for any age, or none")

    blocks = range(len(s.blocks))
    no_eps = [0] * len(blocks)

    def at(X=none, Y=none, Q=(), R=(), eps=no_eps):
        G = [A @ X + (s.B @ Y if fed else none) for A, fed in zip(s.open, s.fed)]
        out = [
            (s.open_D @ X if i == 0 else none) + (s.D2 @ Y if fed else none)
            for i, fed in enumerate(s.fed)
        ]
        matrices = [[each.get(j, none) for j in places] for each in (dict(Q), dict(R))]
        return omega(s, (G, out, [H @ X for H in s.H]), X, *matrices, eps, k1, k2, gamma)

    constant = at()
    Z = sn.symmetric(Z, constant.n)
    W = {"X": sn.symmetric(X, n)} | {j: sn.symmetric(A, n) for j, A in enumerate(Q, 1) if A}
    sn.positive(Z, constant.n, "the multiplier Z")
    for A in W.values():
        sn.positive(A, n, "a multiplier")

    def against(A, B):
        return sum(x * B.get(key, 0) for key, x in A.items())

    units = [M({(i, j): F(1), (j, i): F(1)}) for i in range(n) for j in range(i + 1)]
    unknowns = [({"X": U}, W["X"], U) for U in units]
    unknowns += [({"Q": [(j, U)]}, W[j], U) for U in units for j in places if not s.varies[j]]
    unknowns += [({"R": [(j, U)]}, none, U) for U in units for j in places]
    unknowns += [({"Y": M({(i, j): F(1)})}, none, none) for i in range(s.m) for j in range(n)]
    unknowns += [({"eps": [F(i == k) for k in blocks]}, none, none) for i in blocks]
    for unknown, A, U in unknowns:
        change = at(**unknown).matrix + -1 * constant.matrix
        need(against(change, Z) == against(U, A), "the multipliers do not cancel an unknown")
    need(against(constant.matrix, Z) >= 0, "the multipliers leave a positive constant")
    words = [("any age up to it" if x else "constant") + ", it or more" for x in s.varies[1:]]
    delays = [{"d": d, "age": x, "feedback": y} for d, x, y in zip(s.d[1:], words, s.fed[1:])]
    place = {"k1": [str(x) for x in k1], "k2": [str(x) for x in k2], "delays": delays}
    words = "no X, Y, Q, R, eps meets the LMI of Theorem 2 at these k1, k2"
    return claim_of(s, gamma) | place | {"property": words}


def gamma_floor(c, s):
    gamma, w = sn.text(c["gamma"]), sn.matrix([[x] for x in c["w"]], s.q, 1)
    size, gain = ((x.T @ x).get((0, 0), 0) for x in (w, s.D1 @ w))
    need(gamma > 0 and size > 0 and gain >= gamma**2 * size, "|D1 w| is below gamma |w|")
    words = "no delay, k1, k2 and K meet the LMI of Theorem 2: gamma <= ||D1||"
    return claim_of(s, gamma) | {"property": words, "delays": []}


def analysis(c, s):
    gamma, delays, more = analysis_proved(c, s)
    claim = claim_of(s, gamma)
    both = zip(claim["delays"], delays)
    stated = {"delays": [delay | changed for delay, changed in both]}
    return claim | stated | more | guarantees(c, s)


def output_feedback(c, plant):
    pair = c["pair"]
    need(pair["kind"] in ("analysis", "ages"), "not the proof of a pair")
    s = sn.Loop(pair["system"], pair["K"])
    need_pair(c, plant, s)
    proved = analysis(pair, s)
    need(sn.without_sentences(pair["claim"]) == proved, "the claim of the pair is another")
    return proved | {"observer": observer_claim(c)}


CHECKS = {
    None: (design, "claim system variables K", "guarantees"),
    "analysis": (analysis, "kind claim system variables K", "guarantees"),
    "ages": (analysis, "kind claim system variables K", "guarantees"),
    "refutation": (refutation, "kind claim system at multipliers", ""),
    "gamma floor": (gamma_floor, "kind claim system gamma w", ""),
    "output-feedback": (
        output_feedback,
        "kind claim plant measurements estimated command_age command_any_age K L pair",
        "",
    ),
}


def check(content):
    """Return the claim that the bytes of a certificate prove; RefusedError if they prove none."""
    try:
        c = sn.loaded(content)
        kind = c.get("kind")
        need(kind in CHECKS, f"certificates of kind {kind!r} are not read here")
        proof, required, _ = CHECKS[kind]
        need({*required.split()} <= {*c}, f"expected the keys {required}")
        statement = ("plant", None) if kind == "output-feedback" else ("system", c.get("K"))
        proved = proof(c, sn.Loop(c[statement[0]], statement[1]))
        claim = sn.without_sentences(c["claim"])
        need(claim == proved, "the claim is not the one that is proved")
    except sn.RefusedError:
        raise
    except Exception as error:
        raise sn.RefusedError(f"not a certificate: {error!r}") from error
    return proved


def not_read(c):
    """Yield the keys of a certificate that decide nothing here, as "figures", "system.name"."""
    _, required, optional = CHECKS[c.get("kind")]
    yield from (key for key in c if key not in f"{required} {optional}".split())
    yield from ("claim.hypotheses" for key in c["claim"] if key == "hypotheses")
    for of in ("system", "plant"):
        yield from (f"{of}.{key}" for key in ("name", "integrals") if key in c.get(of, ()))
    for i, x in enumerate(c.get("measurements", ())):
        yield from (f"measurements[{i}].over" for key in x if key == "over")
    yield from (f"pair.{key}" for key in (not_read(c["pair"]) if "pair" in c else ()))
