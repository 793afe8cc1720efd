"""Ages as they are: what is certified, its certificate, and how a file says it."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared import sampled, slow_share_of
from truth_of_ages import gain_over_patterns, period_radius
from truth_of_loops import loop_of, norm

import cosim
from cosim.core import InputError, NotAchievableError
from cosim.hinf import (
    Result,
    analyse,
    auv_system,
    certified_delay,
    check_certificate,
    design,
    greatest_delay,
)
from cosim.hinf.certificate import system_from_json, system_to_json
from cosim.hinf.lmi import Condition
from cosim.hinf.problem import system_from_toml
from cosim.models import Delay, DelaySystem

NETWORKED = -np.array([[3.75, 11.5]])
"""The gain of the networked loop of the literature (Zhang, Branicky, Phillips 2001)."""


def networked(d: float, **age: Any) -> DelaySystem:
    """A = [0 1; 0 -.1], B = [0; .1], the control over a delay of that age."""
    delay = Delay(d, np.zeros((2, 2)), feedback=True, **age)
    return DelaySystem([[0, 1], [0, -0.1]], [[0], [0.1]], delays=[delay])


def scalar(d: float, **age: Any) -> DelaySystem:
    """x' = -x(t - tau)."""
    return DelaySystem([[0.0]], delays=[Delay(d, [[-1.0]], **age)])


def certified(system: DelaySystem, K: Any, order: int) -> Any:
    """An analysis that is certified, and whose certificate, as a file has it, checks."""
    found = analyse(system, K, order=order)
    assert found.certified, found.reason
    proof = check_certificate(json.loads(json.dumps(found.certificate)))
    assert proof.valid, proof.reason
    return found


@pytest.mark.parametrize(
    ("age", "order", "d", "functional"),
    [
        ({"any_age": True}, 1, 1.0625, "interval"),  # Jensen: 1.0422; Wirtinger-based: 1.0625
        ({"sampled": True}, 0, 1.72, "looped"),  # Fridman 2010: 1.69; Seuret 2012: 1.7216
        ({"sampled": True, "least_age": 0.2}, 1, 1.489, "looped"),
        ({"sampled": True, "least_age": 0.6}, 1, 1.385, "looped"),
        ({"rate": 0.1}, 1, 1.138, "rate"),
        ({"rate": 0.0}, 1, 1.165, "rate"),
        ({"any_age": True, "least_age": 0.9}, 1, 1.12, "interval"),
    ],
)
def test_ages_of_the_networked_loop(
    age: dict[str, Any], order: int, d: float, functional: str
) -> None:
    """As far as published conditions reach, or further, each proved exactly."""
    found = certified(networked(d, **age), NETWORKED, order)
    assert found.certificate["kind"] == "ages"
    terms = found.certificate["variables"]["terms"]
    assert [own["functional"] for own in terms] == [functional]


def test_a_constant_delay_of_the_networked_loop() -> None:
    """1.167 s of 1.16714, where the nominal loop loses its stability."""
    certified(networked(1.167), NETWORKED, 2)


def test_the_order_changes_what_is_proved_for_any_age() -> None:
    """Order 0 is Theorem 1, as ever; order 1 proves what it cannot."""
    short, long = networked(0.8695, any_age=True), networked(1.0, any_age=True)
    assert analyse(short, NETWORKED, order=0).certificate["kind"] == "analysis"
    assert not analyse(long, NETWORKED, order=0).certified
    assert analyse(networked(1.0, any_age=True), NETWORKED, order=1).certified


@pytest.mark.parametrize("eta", [0.2, 0.6, 1.0])
def test_wirtinger_beside_looped(eta: float) -> None:
    """The simple condition reaches as far as is published (1.091, .609, .173), the looped further.

    Liu and Fridman 2012 for eta = .2, .6 and 1.
    """
    longest = {0.2: 1.091, 0.6: 0.609, 1.0: 0.173}[eta]
    system = networked(eta + longest, sampled=True, least_age=eta)
    for functional in ("wirtinger", "looped"):
        lmi = Condition(system, NETWORKED, 2, [functional], performance=False)
        found = lmi.margin([eta + longest], None)
        assert found is not None
        assert found[0] > 0, functional
    longer = networked(eta + 1.2 * longest, sampled=True, least_age=eta)
    lmi = Condition(longer, NETWORKED, 2, ["wirtinger"], performance=False)
    margin = lmi.margin([eta + 1.2 * longest], None)
    assert margin is None or margin[0] <= 1e-7


@pytest.mark.parametrize(
    ("age", "end"),
    [
        ({"any_age": True}, 1.5),  # Myshkis: x' = -x(t - tau(t)) is stable for every tau < 3/2
        ({"sampled": True}, 2.0),
        ({"rate": 0.0}, np.pi / 2),
    ],
)
def test_nothing_is_claimed_beyond_the_known_end(age: dict[str, Any], end: float) -> None:
    """x' = -x(t - tau): the greatest certified age lies below the true one, and not far below."""
    found = certified_delay(scalar(0.5, **age), order=1, limit=4.0)
    assert found.delay is not None
    assert 0.85 * end < found.delay < end


def test_a_sampled_age_may_exceed_the_margin_of_the_constant_one() -> None:
    """At d = 1.7 s the networked loop is unstable with a constant delay, and stable sampled."""
    assert not analyse(networked(1.7, any_age=True), NETWORKED, order=1).certified
    found = certified(networked(1.7, sampled=True), NETWORKED, 0)
    assert found.system.delays[0].constant_age == 0.85


def random_loop(seed: int) -> tuple[Any, Any]:
    """A and G of x' = A x + G x(t - tau), stable without a delay."""
    rng = np.random.default_rng(seed)
    n = 2 + seed % 2
    A, G = rng.standard_normal((n, n)) - 0.6 * np.eye(n), rng.standard_normal((n, n))
    while max(np.linalg.eigvals(A + G).real) > -0.3:
        G -= 0.2 * np.eye(n)
    return A, G


PATTERNS = ([1.0], [0.2, 1.0], [0.6, 1.0], [0.05, 1.0, 1.0], [0.3, 0.7, 1.0])


def longest_stable(A: Any, G: Any, eta: float) -> float:
    """The longest interval up to which every pattern is stable, by steps of a twentieth."""
    h = 0.01
    while h < 30 and all(
        period_radius(A, G, [1.05 * h * x for x in pattern], eta) < 1 for pattern in PATTERNS
    ):
        h *= 1.05
    return h


@pytest.mark.slow
@pytest.mark.parametrize("seed", sampled(range(10), 1))
def test_no_sampled_claim_is_beyond_a_pattern_of_intervals(seed: int) -> None:
    """Nothing is certified where a pattern of one to three intervals diverges; most below is."""
    A, G = random_loop(seed)
    eta = (0.0, 0.05)[seed % 3 == 1]
    end = longest_stable(A, G, eta)

    def proved(h: float) -> bool:
        delay = Delay(eta + h, G, sampled=True, least_age=eta)
        return analyse(DelaySystem(A, delays=[delay]), order=1).certified

    assert end > 20 or not proved(1.06 * end)
    assert proved(0.55 * min(end, 10.0))


@pytest.mark.parametrize("seed", sampled(range(5), 1))
def test_no_interval_claim_is_beyond_a_sawtooth(seed: int) -> None:
    """An age of any variation up to d may be a sampled one: a latency, then intervals."""
    A, G = random_loop(seed)
    d = min(longest_stable(A, G, 0.0), 10.0)
    shares = (1.06, 0.8, 0.6, 0.45, 0.3)
    proved = [
        share * d
        for share in shares
        if analyse(DelaySystem(A, delays=[Delay(share * d, G, any_age=True)]), order=1).certified
    ]
    assert proved
    for eta in (0.0, 0.3 * proved[0], 0.7 * proved[0]):
        for pattern in PATTERNS:
            h = proved[0] - eta
            assert period_radius(A, G, [h * x for x in pattern], eta) < 1 + 1e-9


@pytest.mark.parametrize(
    "age", [{"any_age": True, "least_age": 0.2}, {"rate": 0.2, "least_age": 0.2}]
)
def test_gamma_is_above_every_constant_age_and_uncertainty(age: dict[str, Any]) -> None:
    """The exact norm with any constant age in the interval, and any F, is below gamma."""
    system = DelaySystem(
        [[0, 1], [-1, -0.8]],
        C=[[0], [1]],
        D=[[1, 0], [0, 0.5]],
        E=[[0], [0.3]],
        H=[[0.5, 0.2]],
        delays=[Delay(0.5, [[0, 0], [-0.5, -0.4]], H=[[0.3, 0.1]], **age)],
    )
    found = certified(system, None, 1)
    worst = max(
        norm(
            loop_of(
                DelaySystem(
                    system.A,
                    C=system.C,
                    D=system.D,
                    E=system.E,
                    H=system.H,
                    delays=[Delay(d, system.delays[0].A, H=system.delays[0].H)],
                ),
                F=[[F]],
            )
        )
        for d in (0.2, 0.35, 0.5)
        for F in (-1.0, 0.0, 1.0)
    )
    assert worst < found.gamma < 1.3 * worst


def test_a_narrower_age_proves_a_smaller_gamma() -> None:
    """The same loop: any age up to d, from least_age on, with a bounded rate, constant."""

    def gamma(**age: Any) -> float:
        system = DelaySystem(
            [[0, 1], [-1, -0.8]],
            C=[[0], [1]],
            D=[[1, 0]],
            delays=[Delay(0.8, [[0, 0], [-0.5, -0.4]], **age)],
        )
        found = certified(system, None, 1)
        assert found.gamma is not None
        return found.gamma

    ages = [{"any_age": True}, {"any_age": True, "least_age": 0.5}]
    ages += [{"rate": 0.2, "least_age": 0.5}, {"rate": 0.0, "least_age": 0.5}]
    gammas = [gamma(**age) for age in ages]
    assert gammas == sorted(gammas, reverse=True)
    assert gammas[0] > 1.01 * gammas[-1]
    assert gamma(sampled=True) < gammas[0]


@pytest.mark.slow
def test_a_sampled_gamma_is_above_what_patterns_attain() -> None:
    """Sinusoids near the peak over regular and irregular samples, from rest."""
    A, G = np.array([[0.0, 1.0], [-1.0, -0.4]]), np.array([[0.0, 0.0], [-0.3, -0.5]])
    C, D = np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
    system = DelaySystem(A, C=C, D=D, delays=[Delay(0.6, G, sampled=True)])
    gamma = certified(system, None, 1).gamma
    attained = max(
        gain_over_patterns(A, G, C, D, pattern, omega)
        for pattern in ([0.6], [0.3, 0.6], [0.1, 0.6, 0.6])
        for omega in (0.8, 1.0, 1.1, 1.2, 1.4)
    )
    assert attained < gamma < 1.5 * attained


PINNED = Path(cosim.__file__).parent / "scenario" / "library" / "designs" / "auv-1.25s.json"


@pytest.mark.slow
def test_the_vehicle_with_its_links_as_they_are() -> None:
    """The pinned gain, the age between .5 and 1.25 s however it varies: gamma 2.86, not 3.42.

    In the links of its scenario a message is never younger than .5 s (.25 s each way).
    """
    K = json.loads(PINNED.read_text())["K"]
    vehicle = auv_system()
    state, loop = vehicle.delays
    system = replace(vehicle, delays=(state, replace(loop, least_age=0.5)))
    found = certified(system, K, 1)
    assert 2.85 < found.gamma < 2.86


def test_parts_of_a_loop_are_solved_apart_without_loss() -> None:
    """Two loops side by side, then mixed by a rotation that hides the parts: the same gamma."""
    A, G = np.diag([-1.0, -2.0]), np.diag([-0.5, 0.4])
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])

    def least(T: Any) -> tuple[int, float]:
        system = DelaySystem(
            T @ A @ T.T,
            C=T,
            D=T.T,
            E=T,
            H=0.3 * T.T,
            delays=[Delay(0.7, T @ G @ T.T, H=0.1 * T.T, any_age=True)],
        )
        lmi = Condition(system, np.zeros((0, 2)), 1, ["interval"], performance=True)
        found = lmi.least_gamma([0.7], 1.0)
        assert found is not None
        return lmi.largest_part([0.7]), found

    (apart, one), (whole, other) = least(np.eye(2)), least(turn)
    assert (apart, whole) == (7, 14)
    assert one == pytest.approx(other, rel=1e-5)


CERTIFICATES = [
    networked(1.0, any_age=True),
    networked(1.1, any_age=True, least_age=0.9),
    networked(1.1, rate=0.1, least_age=0.2),
    networked(1.2, sampled=True, least_age=0.2),
    networked(1.5, sampled=True),
]


@pytest.mark.parametrize(
    "system",
    CERTIFICATES,
    ids=lambda s: (
        s.delays[0].any_age
        and repr((s.delays[0].d, s.delays[0].least_age, s.delays[0].rate, s.delays[0].sampled))
    ),
)
def test_a_changed_certificate_is_refused(system: DelaySystem) -> None:
    """Another age, gain, system, functional or matrix: not proved, or not a certificate."""
    data = json.loads(json.dumps(certified(system, NETWORKED, 1).certificate))
    assert check_certificate(data).valid

    def refused(change: Any) -> None:
        other = copy.deepcopy(data)
        change(other)
        assert other != data
        try:
            proof = check_certificate(other)
        except InputError:
            return
        assert not proof.valid

    def longer(other: dict[str, Any]) -> None:
        for own in (other["system"]["delays"][0], other["claim"]["delays"][0]):
            own["d"] *= 1.5

    refused(longer)
    refused(lambda c: c["claim"]["delays"][0].update(d=9.0))
    refused(lambda c: c["claim"]["delays"][0].update(age="constant, up to d"))
    refused(lambda c: c["claim"].update(hypotheses=[]))
    refused(lambda c: c.update(K=[[3.75, 11.5]]))
    refused(lambda c: c["system"]["A"][1].__setitem__(1, 0.9))
    refused(lambda c: c["variables"]["terms"][0].update(functional="constant"))
    refused(lambda c: c["variables"].update(order=0))
    refused(lambda c: c["variables"]["P"][0].__setitem__(0, "-1"))
    refused(lambda c: c["variables"]["P"][0].__setitem__(1, "1/3"))  # not symmetric
    for name, rows in data["variables"]["terms"][0]["matrices"].items():
        refused(lambda c, name=name: c["variables"]["terms"][0]["matrices"].pop(name))
        worse = [[str(-40 * Fraction(entry)) for entry in row] for row in rows]
        refused(lambda c, n=name, w=worse: c["variables"]["terms"][0]["matrices"].update({n: w}))


def test_an_age_claimed_without_its_bound_is_refused() -> None:
    """What is proved sampled does not pass for any age, nor a rate for a greater one."""
    for system, key in ((CERTIFICATES[4], "sampled"), (CERTIFICATES[2], "rate")):
        data = json.loads(json.dumps(certified(system, NETWORKED, 1).certificate))
        other = copy.deepcopy(data)
        other["system"]["delays"][0].pop(key)
        with pytest.raises(InputError, match="does not hold for the delay"):
            check_certificate(other)
    data["system"]["delays"][0]["rate"] = 3.0
    data["claim"]["delays"][0]["rate"] = 3.0
    assert not check_certificate(data).valid


def test_a_constant_delay_beside_an_age_is_covered_down_to_zero() -> None:
    """Where it can be proved at the same gamma; a certificate that says so for less is refused."""
    system = DelaySystem(
        [[0, 1], [-1, -0.8]],
        C=[[0], [1]],
        D=[[1, 0]],
        delays=[
            Delay(0.3, [[0, 0], [-0.1, -0.1]]),
            Delay(0.4, [[0, 0], [-0.4, -0.3]], any_age=True),
        ],
    )
    found = analyse(system, gamma=1.05, order=1)
    assert found.covers_smaller_delays
    data = json.loads(json.dumps(found.certificate))
    assert data["claim"]["delays"][0]["age"] == "constant, up to d"
    assert check_certificate(data).valid
    close = analyse(system, order=1)
    assert not close.covers_smaller_delays
    data = json.loads(json.dumps(close.certificate))
    data["variables"]["down_to_zero"] = True
    data["claim"]["delays"][0]["age"] = "constant, up to d"
    del data["theorem"]
    proof = check_certificate(data)
    assert not proof.valid
    assert "-Phi at age 0" in str(proof.reason)


FILE = """
[system]
A = [[0, 1], [0, -0.1]]
B = [[0], [0.1]]
[[system.delays]]
d = 1.25
feedback = true
{age}
"""


@pytest.mark.parametrize(
    ("age", "fields"),
    [
        ("any_age = true\nleast_age = 0.5", (True, 0.5, None, False)),
        ("rate = 0.1", (True, 0.0, 0.1, False)),
        ("sampled = true\nleast_age = 0.25", (True, 0.25, None, True)),
        ("any_age = true", (True, 0.0, None, False)),
        ("", (False, 0.0, None, False)),
    ],
)
def test_a_file_says_how_an_age_varies(age: str, fields: tuple[Any, ...]) -> None:
    """And a certificate's JSON keeps it; an old one has no further keys."""
    system = system_from_toml(FILE.format(age=age), where="file", name="x").system
    again = system_from_json(json.loads(json.dumps(system_to_json(system))))
    for own in (system.delays[0], again.delays[0]):
        assert (own.any_age, own.least_age, own.rate, own.sampled) == fields
    keys = set(system_to_json(system)["delays"][0])
    assert keys - {"d", "A", "feedback", "any_age"} == {
        line.split()[0] for line in age.splitlines()
    } - {"any_age"}


@pytest.mark.parametrize(
    ("age", "message"),
    [
        ("least_age = 0.5", "constant delay"),
        ("any_age = true\nleast_age = 1.25", "less than d"),
        ("any_age = true\nleast_age = -0.5", "at least 0"),
        ("rate = -0.1", "rate"),
        ("rate = 0.1\nsampled = true", "jumps"),
        ("sampled = 0.75", "d - least_age"),
    ],
)
def test_a_file_with_an_impossible_age_is_refused(age: str, message: str) -> None:
    """With the place and what was expected."""
    with pytest.raises(InputError, match=message) as error:
        system_from_toml(FILE.format(age=age), where="file", name="x")
    assert "delays[0]" in str(error.value)


def test_many_ages_are_still_analysed() -> None:
    """With too many corners for a proof the ages count as of any variation, as at order 0."""
    delays = [Delay(0.1, [[-0.05]], any_age=True) for _ in range(7)]
    found = certified(DelaySystem([[-1.0]], delays=delays), None, 1)
    assert found.certificate["kind"] == "analysis"


PERFORMANCE = {"C": [[0], [1]], "D": [[1, 0], [0, 0]], "D2": [[0], [0.1]]}


@pytest.mark.parametrize(
    ("age", "d", "best"),
    slow_share_of(
        [
            ({"sampled": True}, 3.0, 10.6),  # Theorem 2, for any age up to 3 s or shorter: 15.6
            ({"any_age": True, "least_age": 0.5}, 1.2, 5.8),  # 7.4
            ({"rate": 0.1}, 1.2, 6.0),  # 6.9
        ]
    ),
)
def test_a_gain_is_designed_for_the_ages(age: dict[str, Any], d: float, best: float) -> None:
    """By the LMI of the ages, better than what Theorem 2 proposes; proved, written and read."""
    delay = Delay(d, np.zeros((2, 2)), feedback=True, **age)
    system = DelaySystem([[0, 1], [0, -0.1]], [[0], [0.1]], **PERFORMANCE, delays=[delay])
    found = design(system, [-0.5], [1.0], search=False)
    assert found.gamma is not None
    assert found.gamma < best
    assert found.certificate["kind"] == "ages"
    data = json.loads(json.dumps(found.to_json()))
    assert check_certificate(data).valid
    again = Result.from_json(data, where="file")
    assert (again.gamma, again.K.tolist()) == (found.gamma, found.K.tolist())
    assert again.system.delays[0].sampled is delay.sampled
    given = design(system, gain=found.K, gamma=1.01 * found.gamma)
    assert given.gamma == 1.01 * found.gamma


SAMPLED = {
    "A": [[0, 1], [0, -0.1]],
    "B": [[0], [0.1]],
    "delays": [Delay(3.0, np.zeros((2, 2)), feedback=True, sampled=True)],
}


def test_a_stable_gain_is_designed_for_sampled_ages() -> None:
    """Without w and z, at an interval where any age up to it has no gain by Theorem 2."""
    found = design(DelaySystem(**SAMPLED), [-0.5], [1.0], search=False)
    assert check_certificate(found.certificate).valid


@pytest.mark.slow
def test_a_gain_is_designed_to_meet_a_gamma() -> None:
    """One that only the LMI of the ages reaches; less is refused with the least that was found."""
    system = DelaySystem(**SAMPLED, **PERFORMANCE)
    assert design(system, [-0.5], [1.0], gamma=11.5, search=False).gamma == 11.5
    with pytest.raises(NotAchievableError, match="not reached") as error:
        design(system, [-0.5], [1.0], gamma=5.0, search=False, alternatives=False)
    assert "10.3" in str(error.value.got)


def test_a_greatest_delay_uses_known_ages() -> None:
    """A sampled age may be longer than one of any variation; Theorem 2 does not know it."""
    delay = Delay(0.5, [[0.0]], feedback=True, sampled=True)
    system = DelaySystem([[0.5]], [[1.0]], delays=[delay])
    plain, known = (
        greatest_delay(system, None, order=order, limit=4.0) for order in (None, "auto")
    )
    assert known.delay > 1.1 * plain.delay
    assert known.result.certificate["kind"] == "ages"
    proof = check_certificate(known.result.certificate)
    assert proof.valid
    assert proof.claim["delays"][0]["d"] == known.delay
    assert plain.refuted_at is not None
