"""At unknowns at random, every inequality of the product is that of the standalone checker.

The two share no line: whoever changes a weight in one of them is told here, whether or not a
certificate becomes false by it. What neither reads, the words of an age, is executed.
"""

from __future__ import annotations

import json
import re
from dataclasses import replace
from fractions import Fraction
from typing import Any

import flint
import numpy as np
import pytest
from shared import sampled, slow_share_of
from solver_points import Point

from cosim.hinf.certificate import (
    Decay,
    Guarantees,
    Outages,
    check_certificate,
    loop_claim,
    loop_to_json,
    shapes_of_outages,
    standalone,
    system_from_json,
)
from cosim.hinf.exact import exact
from cosim.hinf.theorems import (
    AgesTheorem,
    Inequality,
    Modes,
    Proof,
    Shape,
    constants_down_to_zero,
    exact_unknowns,
    functionals_of,
    rates_from_rows,
    supports_of,
)
from cosim.models import Delay, DelaySystem

Rng = np.random.Generator
Entries = dict[tuple[int, int], Fraction]


def system_of(rng: Rng, *delays: Delay) -> DelaySystem:
    """Three states, two controls, two blocks of F; entries of few digits, some of them zero."""

    def r(*shape: int) -> Any:
        return np.round(rng.normal(size=shape), 1) * (rng.random(shape) < 0.8)

    return DelaySystem(
        *(r(3, 3), r(3, 2), r(3, 2), r(2, 3)),
        D1=r(2, 2),
        D2=r(2, 2),
        E=r(3, 3),
        H=r(2, 3),
        uncertainty_blocks=[(1, 1), (2, 1)],
        delays=[
            replace(x, A=r(3, 3) * bool(x.A.any()), H=r(2, 3) * bool(x.A.any())) for x in delays
        ],
    )


def delay(d: float, **kinds: Any) -> Delay:
    return Delay(d, np.zeros((3, 3)) if kinds.pop("bare", False) else np.eye(3), **kinds)


def matrix(rng: Rng, *shape: int) -> Any:
    return np.round(rng.normal(size=shape), 2)


def symmetric(rng: Rng, n: int) -> Any:
    half = matrix(rng, n, n)
    return half + half.T


def both(
    document: dict[str, Any], patch: pytest.MonkeyPatch
) -> tuple[list[Entries], list[Entries]]:
    """What the product and the standalone checker show to be positive, but what stands alone."""
    ours: list[Entries] = []
    theirs: list[Entries] = []
    system = system_from_json(document["system"])

    def failure(form: Inequality, values: Any) -> None:
        if len(form.rows) > 1 or form.name[:2] in ("P,", "-P"):
            ours.append(entries(form, values, system))

    def positive(A: Any, n: int, name: str) -> None:
        del n
        if name.startswith(("-", "[", "P with")):
            theirs.append({key: x for key, x in A.items() if x})

    with patch.context() as patched:
        patched.setattr(Inequality, "failure", failure)
        patched.setattr(standalone.arithmetic, "positive", positive)
        assert check_certificate(document).valid
        standalone.check(json.dumps(document).encode())
    return ours, theirs


def entries(form: Inequality, values: Any, system: DelaySystem) -> Entries:
    """The matrix, with rows r_j of Theorem 2 in place of rows s_j."""
    lower = form.at(values)
    n = len(lower)
    whole = flint.fmpq_mat(n, n, [lower[max(i, j)][min(i, j)] for i in range(n) for j in range(n)])
    if any(re.fullmatch(r"s\d+", name) for name in form.rows):
        back = rates_from_rows(system, form).inv()
        whole = back.transpose() * whole * back
    return {
        (i, j): Fraction(int(x.p), int(x.q))
        for i in range(n)
        for j in range(n)
        if (x := whole[i, j]) != 0
    }


def same(found: tuple[list[Entries], list[Entries]], count: int) -> None:
    ours, theirs = (sorted(map(sorted, map(dict.items, each))) for each in found)
    assert len(ours) >= count
    assert ours == theirs


def gain_of(rng: Rng) -> Any:
    return matrix(rng, 2, 3)


def theorem_2(rng: Rng, system: DelaySystem) -> Point:
    late = system.delays
    unknowns = {"X": symmetric(rng, 3) + 9 * np.eye(3)} | NUMBERS
    unknowns |= {f"Q[{j}]": symmetric(rng, 3) * (not x.any_age) for j, x in enumerate(late)}
    unknowns |= {f"R[{j}]": symmetric(rng, 3) + 9 * np.eye(3) for j, _ in enumerate(late)}
    k1 = tuple(-1.0 - j for j, _ in enumerate(late))
    return Point(k1, tuple(0.5 + j for j, _ in enumerate(late)), unknowns)


NUMBERS: dict[str, Any] = {"eps[0]": 0.5, "eps[1]": 0.25, "gamma": 3.0}


def drawn(rng: Rng, shapes: dict[str, Shape]) -> dict[str, Any]:
    """Matrices of these shapes, and the numbers above."""
    return {
        name: NUMBERS[name.replace("_out", "")]
        if x.is_number
        else symmetric(rng, x.height)
        if x.symmetric
        else matrix(rng, x.height, x.width)
        for name, x in shapes.items()
    }


SEEDS = [0, *slow_share_of(range(1, 20))]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("feedback", ["at once", "late"])
def test_theorem_2_and_decay(seed: int, feedback: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also of a delay of zero, and at every corner of the growths."""
    rng, late = np.random.default_rng(seed), feedback == "late"
    delays = delay(0.5), delay(0.0), delay(0.25, any_age=True, feedback=late)
    system = system_of(rng, *delays)
    v = theorem_2(rng, system)
    gain = gain_of(rng)
    whole = v.proof(system, gain)
    unknowns = {name: x for name, x in whole.unknowns.items() if name != "gamma"}
    growth = exact(2.0), exact(2.0), exact(2.0)
    decay = Decay(exact(0.125), growth, Proof(whole.theorem, unknowns))
    same(both(v.document(system, gain, Guarantees(decay=decay)), monkeypatch), 3)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("lower", [False, True])
@pytest.mark.parametrize("order", [0, 1, 3])
def test_constant_and_any_ages(
    order: int,
    lower: bool,  # noqa: FBT001 - drawn
    seed: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(seed)
    system = system_of(rng, delay(0.5), delay(0.25, any_age=True, feedback=True), delay(0.0))
    least = (exact(0.125), None) if lower and order else None
    theorem, gain = AgesTheorem.analysis(system, order, least), gain_of(rng)
    v = Proof(theorem, drawn(rng, theorem.shapes(system, gain, bounded=True)))
    document = loop_to_json(system, gain, v.exactly(system, gain))
    same(both(document, monkeypatch), 2)


KINDS: dict[str, dict[str, Any]] = {
    "constant": {},
    "interval": {"any_age": True},
    "rate": {"any_age": True, "rate": 0.5},
    "sampled": {"any_age": True, "sampled": True},
}


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("order", sampled([1, 0, 2], 1))
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("least", [0.0, 0.125])
def test_ages_as_they_are(
    kind: str, least: float, order: int, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every functional of the kind, beside another delay, about the whole state and on supports."""
    rng = np.random.default_rng(seed)
    more = KINDS[kind] | ({} if kind == "constant" else {"least_age": least})
    beside = {"any_age": True, "sampled": True, "least_age": 0.125} if seed % 2 else {}
    system = system_of(rng, delay(0.5, **beside), delay(0.25, bare=True, feedback=True, **more))
    gain = gain_of(rng) * [[1], [0]]
    for functional in functionals_of(system.delays[1]):
        own = functionals_of(system.delays[0])[0], functional
        for supports in ((None, None), supports_of(system, gain, controls=bool(seed % 3))):
            down = bool(order) and bool(rng.random() < 0.5)
            lower = constants_down_to_zero(own) if down else None
            theorem = AgesTheorem(order, own, supports, lower)
            v = Proof(theorem, drawn(rng, theorem.shapes(system, gain, bounded=True)))
            document = loop_to_json(system, gain, v.exactly(system, gain))
            same(both(document, monkeypatch), 2)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("age", [0.0, 0.125, 0.25])
@pytest.mark.parametrize("plant_age", [False, True])
def test_outages(
    age: float,
    plant_age: bool,  # noqa: FBT001 - drawn
    seed: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Both modes, a fallback at once and of every age up to the feedback's."""
    rng = np.random.default_rng(seed)
    system = system_of(
        rng, delay(0.5, any_age=plant_age), delay(0.25, bare=True, feedback=True, any_age=True)
    )
    modes = Modes(
        alpha=exact(0.125),
        beta=exact(0.5),
        gamma=exact(3.0),
        rho=(exact(0.5), exact(0.75)),
        fallback=gain_of(rng),
        fallback_age=age,
    )
    gain = gain_of(rng)
    shapes = shapes_of_outages(system, gain, modes)
    outages = Outages(**vars(modes), unknowns=exact_unknowns(shapes, drawn(rng, shapes)))
    document = theorem_2(rng, system).document(system, gain, Guarantees(outages=outages))
    same(both(document, monkeypatch), 4)


def test_the_words_of_a_sampled_age_are_those_ages() -> None:
    """Executed: exactly the ages from least_age on, at rate one, to below d, come out."""
    system = system_of(
        np.random.default_rng(0), delay(0.5, any_age=True, sampled=True, least_age=0.125)
    )
    claim = loop_claim(system, Proof(AgesTheorem(0, ("looped",), (None,)), {}))
    (words,) = (x for x in claim["hypotheses"] if x.startswith("a sampled age"))
    named = re.fullmatch(
        r"a sampled age, a = least_age: x\(t - age\) = x\(s_k\) for (.+?), (.+?), (.+?), finitely "
        r"many s_k in any bounded time",
        words,
    )
    assert named is not None
    here, apart, first = (
        text.replace("s_(k+1)", "following").replace("s_k", "now").replace("s_0", "now")
        for text in named.groups()
    )
    a, d, unit = 0.125, 0.5, 1 / 64  # doubles without rounding
    ages, gaps = set(), set()
    for i in range(-64, 65):
        for j in range(-64, 65):
            place = {"a": a, "d": d, "now": i * unit, "following": j * unit}
            if not eval(apart, {}, place):  # noqa: S307 - our own words
                continue
            gaps.add(j - i)
            for k in range(-64, 65):
                if eval(here, {}, place | {"t": k * unit}):  # noqa: S307
                    ages.add(k - i)
    assert gaps == set(range(1, 25))  # of (0, d - a] = (0, 24 / 64]
    assert ages == set(range(8, 32))  # of [a, d) = [8 / 64, 32 / 64)
    assert [eval(first, {}, {"a": a, "now": x}) for x in (-a, -a + unit)] == [True, False]  # noqa: S307
