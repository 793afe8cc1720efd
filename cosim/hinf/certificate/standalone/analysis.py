"""The analyses that `checker.py` checks: Bessel-Legendre of any order, and ages as they are.

docs/explanation/theory.md derives the functionals, and has the letters: V is y'P y with one group
of terms per positive delay, Phi what bounds its derivative. Shown are -Phi > 0 at every corner of
the ages, and V > 0. An analysis of order N is one with constant delays; of order 0 where any age is
allowed, and then without Q. The terms of a delay are about y = C x, C the identity or the support
that the certificate gives: of the states, or of the controls, that act through the delay.
"""

# mypy: ignore-errors
# ruff: noqa: ANN001, ANN201, ANN204, B905, C901, D102, D103, N817

from fractions import Fraction as F
from itertools import accumulate, combinations, product

from . import arithmetic as sn

M, need, total = sn.M, sn.need, sn.total

UP_TO, EXACTLY, ANY = "constant, up to d", "constant, exactly d", "any, however it varies, "
PI2 = F(333, 106) ** 2  # below pi^2
OWN = {"constant": "", "interval": "S Z M", "rate": "S_1 S_2 Z M", "wirtinger": "W"}
OWN["looped"] = "U X_a X_b Y"


class Term:
    """A positive delay: its functional, lengths, matrices, and the names of its rows."""

    def __init__(self, s, j, kind, order, table):
        self.j, self.kind, self.order = j, kind, order
        self.C, self.n, self.A, self.H, self.D = on_support(s, j, table)
        self.d, self.a, self.rate = (
            s.d[j],
            F(0) if kind == "constant" else s.a[j],
            s.rate[j] or F(0),
        )
        self.length, self.rest = self.d if kind == "constant" else self.a, self.d - self.a
        self.start = f"h{j}" if self.a > 0 else "x"
        between, at_least = kind in ("interval", "rate"), [f"h{j}"] * (self.a > 0)
        means = [f"W{j},{k}" for k in range(order * (self.length > 0))]
        middle = [f"a{j}", f"b{j}"] * (between and order > 0)
        self.rows = [f"x{j}", *means] if kind == "constant" else [*at_least, *means, f"x{j}"]
        self.rows += [f"d{j}"] * between + middle
        self.rows += [f"t{j}", f"r{j}"] * (kind == "looped" and self.a > 0)
        one = [f"ab{j}"] * (order > 0)
        self.blocks = means + {"looped": at_least, "interval": one, "rate": middle}.get(kind, [])

    def read(self, table, rows, *, crude):
        n = self.n
        names = OWN[self.kind] + " N" * (self.kind == "looped" and self.a > 0)
        names += " R" * (self.length > 0) + " Q" * (self.length > 0 and not crude)
        m, two = n * (1 + (self.a > 0)), n * (1 + (self.order > 0))
        shapes = dict.fromkeys(("U", "X_a", "X_b"), (m, m)) | {"Y": (rows, m), "M": (two, two)}
        sn.values(table, names)
        self.m, self.at = m // n, {"Q": M()}
        for name in names.split():
            shape = shapes.get(name, (n, n))
            self.at[name] = sn.matrix(table[name], *shape)
            if name not in ("M", "X_b", "Y"):
                need(self.at[name] == self.at[name].T, f"{name} is not symmetric")
            if name not in ("M", "X_b", "Y", "U", "X_a"):
                sn.positive(self.at[name], n, name)
        if "M" in self.at:  # [Zh M; M' Zh] > 0
            self.Zh = self.at["Z"] + 3 * self.at["Z"].at(n, n) if self.order else self.at["Z"]
            M_ = self.at["M"].at(0, two)
            sn.positive(self.Zh + self.Zh.at(two, two) + M_ + M_.T, 2 * two, "[Z M; M' Z]")

    def corners(self, lengths):
        """The ages at which Phi is shown, or lengths of a constant delay, each with a slope."""
        ages = [self.a, self.d] if self.order or self.kind == "looped" else [self.a]
        slopes = [-self.rate, self.rate] if self.kind == "rate" else [F(0)]
        fixed = {"constant": lengths, "wirtinger": [self.a]}
        return list(product(fixed.get(self.kind, ages), slopes))

    def now_and_start(self, o):
        """C x(t), and y at the least age."""
        x = self.C @ o["x"]
        return x, o[self.start] if self.a else x

    def loop_maps(self, o):
        """z and z_0 of a looped functional."""
        (x, h), now = self.now_and_start(o), o[f"x{self.j}"]
        if not self.a:
            return x + -1 * now, now
        t, n = o[f"t{self.j}"], self.n
        return x + -1 * t + (h + -1 * now).at(n, 0), t + now.at(n, 0)

    def add_to(self, o, f, corner, everything):
        """Add this delay's part of Phi, x' = f; return its blocks of V with their derivatives."""
        j, at, n, (age, slope), blocks = self.j, self.at, self.n, corner, []
        (x, start), now, f = self.now_and_start(o), o[f"x{j}"], self.C @ f
        if self.length > 0:
            end, length = (now, age) if self.kind == "constant" else (start, self.a)
            o.square(x, at["Q"])
            o.square(end, at["Q"], -1)
            o.square(f, at["R"], length**2)
            for k in range(self.order + 1):
                means = (-2 * (2 * i + 1) * o[f"W{j},{i}"] for i in range(k) if (i + k) % 2)
                change = x + (-1) ** (k + 1) * end + total(means)
                o.square(change, at["R"], -(2 * k + 1))
                if k < self.order:
                    blocks.append((length * o[f"W{j},{k}"], change))
        if "Z" in at:
            last, a, b = o[f"d{j}"], o[f"a{j}"], o[f"b{j}"]
            young, old = start + -1 * now, now + -1 * last
            if self.order:
                young = young + (start + now + -2 * a).at(n, 0)
                old = old + (now + last + -2 * b).at(n, 0)
            o.square(f, at["Z"], self.rest**2)
            o.square(young, self.Zh, -1)
            o.square(old, self.Zh, -1)
            o.add(young, at["M"] @ old, -1)
            one, two = at.get("S_1", at.get("S")), at.get("S_2", at.get("S"))
            for y, A, weight in ((start, one, 1), (now, one, slope - 1), (now, two, 1 - slope)):
                o.square(y, A, weight)
            o.square(last, two, -1)
            a, b = (age - self.a) * a, (self.d - age) * b
            first, second = start + (slope - 1) * now, (1 - slope) * now + -1 * last
            if self.order:
                blocks += [(a + b, first + second)] if "S" in at else [(a, first), (b, second)]
        if self.kind == "wirtinger":
            o.square(f, at["W"], self.rest**2)
            o.square(start + -1 * now, at["W"], -PI2 / 4)
        if self.kind == "looped":
            (z, z_0), rate = self.loop_maps(o), f
            if self.a:
                oldest = o[f"r{j}"]
                o.square(f, at["N"])
                o.square(oldest, at["N"], -1)
                rate = f + oldest.at(n, 0)
                blocks.append((start, oldest))
            o.square(z, at["X_a"], -1)
            o.add(z, at["X_b"] @ z_0, -1)
            o.add(everything, at["Y"] @ z, -1)
            if age == self.d:
                o.add(everything, at["Y"] @ o[f"v{j}"], self.rest)
                o.square(o[f"v{j}"], at["U"], -self.rest)
            else:
                o.square(rate, at["U"], self.rest)
                o.add(rate, at["X_a"] @ z + at["X_b"] @ z_0, self.rest)
        return blocks

    def add_to_value(self, o, *, sampled):
        """Add what V has at least beside y'P y; sampled: just after a sampling instant."""
        j, at = self.j, self.at
        for k in range(self.order):
            o.square(o[f"W{j},{k}"], at["Q"], (2 * k + 1) / self.length if self.length else 0)
        for row, name in (("ab", "S"), ("a", "S_1"), ("b", "S_2")):
            o.square(o[f"{row}{j}"], at.get(name, M()), 1 / self.rest if self.rest else 0)
        if sampled:
            z, z_0 = self.loop_maps(o)
            if self.a:
                x, start = self.now_and_start(o)
                o.square(x + -1 * start, at["N"], 1 / self.a)
            o.square(z, self.rest * at["X_a"] + at["U"])
            o.add(z, at["X_b"] @ z_0, self.rest)


def on_support(s, j, table):
    """Return C, its rows, and A', H', D' with A' C, H' C, D' C the matrices of delay j."""
    given = [key for key in ("states", "controls") if key in table]
    need(len(given) < 2, "two supports")
    if not given:
        return sn.eye(s.n), s.n, s.A[j], s.H[j], s.D[j]
    numbers = [int(sn.number(i)) - 1 for i in table[given[0]]]
    need(numbers == sorted({*numbers}) and numbers, "no support")
    need([i + 1 for i in numbers] == table[given[0]], "half a state")
    size, places = s.n if given == ["states"] else s.m, {x: k for k, x in enumerate(numbers)}
    need(numbers[0] >= 0 and numbers[-1] < size, "a support of what there is not")

    matrices, select = (s.A[j], s.H[j], s.D[j]), M({(i, k): F(1) for i, k in places.items()})
    if given == ["states"]:
        C, parts = select.T, [A @ select for A in matrices]
    else:
        C, parts = select.T @ s.late_gain[j], [s.B @ select, M(), s.D2 @ select]
    same = all(short @ C + M() == A for short, A in zip(parts, matrices))
    need(same, "the delay acts outside its support")
    return C, len(numbers), *parts


def lengths_of(v, s, positive, order):
    """The lengths of every constant delay at which Phi is shown, and the claim about it."""
    if "lower" not in v:
        exact = order > 0 and not v.get("down_to_zero", False)
        ends = [(s.d[j],) if exact or not order else (s.d[j], F(0)) for j in positive]
        return ends, [EXACTLY if exact else UP_TO] * len(positive)
    lower = [None if x is None else sn.text(x) for x in v["lower"]]
    need(order > 0 and len(lower) == len(positive), "lower does not fit")
    need([x is None for x in lower] == [s.varies[j] for j in positive], "lower does not fit")
    need(
        all(x is None or 0 <= x <= s.d[j] for j, x in zip(positive, lower)), "lower is not below d"
    )
    words = [f"constant, from {x} to d" if x else UP_TO for x in lower]
    return [(s.d[j],) if x is None else (s.d[j], x) for j, x in zip(positive, lower)], words


def analysis_proved(c, s):
    """Return gamma, the changes of the claim about every delay, and its further keys."""
    v, ages, n = c["variables"], c["kind"] == "ages", s.n
    sn.values(
        v, "order P eps gamma " + ("terms down_to_zero" if ages else "Q R"), "lower" * (not ages)
    )
    order = int(sn.number(v["order"]))
    need(order == v["order"] and 0 <= order <= 12, "no order")
    need(not ages or isinstance(v["down_to_zero"], bool), "down_to_zero is not true or false")
    positive = [j for j in range(1, len(s.d)) if s.d[j] > 0]
    gamma, eps = (
        sn.scalar(v["gamma"], needed=v["gamma"] is not None),
        s.multipliers(v["eps"]),
    )
    need(gamma is None or (gamma > 0 and s.q and s.p), "gamma is not positive, or bounds nothing")
    given = v["terms"] if ages else [{}] * len(v["Q"])
    if ages:
        for x in given:
            sn.values(x, "matrices functional", "states controls")
        tables, kinds = ([x[key] for x in given] for key in ("matrices", "functional"))
        for j, kind in zip(positive, kinds):
            holds = ["rate"] * (s.rate[j] is not None) + ["looped", "wirtinger"] * s.sampled[j]
            need(
                kind in [*holds, "interval" if s.varies[j] else "constant"], f"{kind} does not hold"
            )
    else:
        tables = [
            {"R": R} | ({} if Q is None else {"Q": Q}) for Q, R in zip(v["Q"], v["R"], strict=True)
        ]
        kinds = ["constant"] * len(tables)
    need(len(tables) == len(kinds) == len(positive), "not one term per positive delay")
    terms = [
        Term(s, j, k, order * (ages or not s.varies[j]), x)
        for j, k, x in zip(positive, kinds, given)
    ]
    rows = [("x", n), *((row, term.n) for term in terms for row in term.rows)]
    rows += [("w", s.q)] * (gamma is not None) + [("p", s.s)]
    for term, table in zip(terms, tables):
        term.read(table, sum(size for _, size in rows), crude=not ages and s.varies[term.j])
    blocks = [("x", n), *((block, term.n) for term in terms for block in term.blocks)]
    *first, size = accumulate([0, *(size for _, size in blocks)])
    P = sn.symmetric(v["P"], size)
    looped = [term for term in terms if term.kind == "looped"]
    for count in range(len(looped) + 1):
        for sampled in combinations(looped, count):
            more = [
                (f"{x}{term.j}", term.n) for term in sampled for x in ["t"] * (term.a > 0) + ["x"]
            ]
            o = sn.Form([*blocks, *more])
            o.square(total(o[block].at(i, 0) for i, (block, _) in zip(first, blocks)), P)
            for term in terms:
                term.add_to_value(o, sampled=term in sampled)
            sn.positive(o.matrix, o.n, "P with what the other terms add to V")
    lengths, words = lengths_of(v, s, positive, order)
    for corner in product(*(term.corners(ends) for term, ends in zip(terms, lengths))):
        further = [t for t, (age, _) in zip(terms, corner) if t.kind == "looped" and age == t.d]
        o = sn.Form([*rows, *((f"v{t.j}", t.m * t.n) for t in further)])
        now = [i for i, d in enumerate(s.d) if not d]  # x(t), and delays of zero
        f, z, q = (
            total(each[i] for i in now) @ o["x"]
            + total(A @ o[f"x{t.j}"] for A, t in zip(of_terms, terms))
            for each, of_terms in (
                (s.A, [t.A for t in terms]),
                (s.D, [t.D for t in terms]),
                (s.H, [t.H for t in terms]),
            )
        )
        f, z = f + s.C @ o["w"] + s.E @ o["p"], z + s.D1 @ o["w"]
        pairs = [(o["x"], f)]
        for term, length in zip(terms, corner):
            pairs += term.add_to(o, f, length, sn.eye(sum(size for _, size in rows)))
        y, rate = (total(x.at(i, 0) for i, x in zip(first, each)) for each in zip(*pairs))
        o.add(y, P @ rate)
        L_p, L_q = s.scalings(eps)
        o.square(q, L_q)
        o.square(o["p"], L_p, -1)
        for x, weight in ((z, gamma and 1 / gamma), (o["w"], gamma and -gamma)):
            o.add(x, x, (weight or 0) / F(2))
        sn.positive(-1 * o.matrix, o.n, "-Phi")
    claims = {j: age_claim(s, t, w) for j, t, w in zip(positive, terms, words)}
    exact = {"age": EXACTLY} if not ages and order and "lower" not in v else {}
    delays = [claims.get(j, {} if s.varies[j] else exact) for j in range(1, len(s.d))]
    return gamma, delays, {"order": order}


def age_claim(s, term, constant):
    if term.kind == "constant":
        return {} if s.varies[term.j] else {"age": constant}
    least = {"least_age": term.a}
    if term.kind == "interval":
        return least | {"age": ANY + "from least_age to d"} if term.a else {"age": ANY + "up to d"}
    if term.kind == "rate":
        return least | {"age": "from least_age to d, |age'| <= rate", "rate": term.rate}
    return least | {"age": "sampled: from least_age at rate one to d at most"}
