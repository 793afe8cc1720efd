"""Bounds on |K| and on the peak of u: never below what happens, and close to closed forms."""

from __future__ import annotations

import itertools
import math

import flint
import numpy as np
import pytest
from heun_integrator import integrate, sawtooth, turning

from cosim.core import InputError, NotAchievableError
from cosim.hinf import Delay, DelaySystem, design
from cosim.hinf.certificate import GainLimit, PeakControl, norm_above, offset_corners
from cosim.hinf.lmi import proved_peak_control
from cosim.hinf.problem import design_constraints_of
from cosim.hinf.synthesis import checked_scalars, starts
from cosim.models import paper_example


def _peak(system: DelaySystem, K: np.ndarray, **asked: object) -> PeakControl:
    """The proof of a bound that nothing limits."""
    design_constraints = design_constraints_of(system, peak_control=1e6, **asked)  # type: ignore[arg-type]
    k2 = [0.5 / delay.d for delay in system.delays]
    scalars = starts(checked_scalars(system, [-x for x in k2], k2))
    found, reason = proved_peak_control(system, K, design_constraints, scalars)
    assert found is not None, reason
    assert found.failure(system, K) is None
    return found


def test_the_norm_of_a_gain_is_bounded_from_just_above() -> None:
    """|[3 4]| = 5: not proved at 4.999999 nor at 5 itself, proved a little above."""
    K = np.array([[3.0, 4.0]])
    system = DelaySystem(np.zeros((2, 2)), np.ones((2, 1)))
    above = norm_above(K)
    assert 5.0 < above < 5.0 * (1 + 1e-9)
    assert GainLimit(flint.fmpq(*above.as_integer_ratio())).failure(system, K) is None
    for bound in (flint.fmpq(4999999, 1000000), flint.fmpq(5), flint.fmpq(-6)):
        assert GainLimit(bound).failure(system, K) is not None


def test_a_gain_is_designed_below_its_limit() -> None:
    """Half of the plain gain's norm: met, for a larger gamma; a tenth more and it is free."""
    system = paper_example.system()
    plain = design(system, (0.6,), (0.2,), order=None)
    norm = float(np.linalg.norm(plain.K, 2))
    found = design(system, (0.6,), (0.2,), gain_limit=norm / 2, order=None)
    assert np.linalg.norm(found.K, 2) <= norm / 2
    assert found.guarantees.gain_limit is not None
    assert plain.gamma is not None
    assert found.gamma is not None
    assert found.gamma > plain.gamma
    again = design(system, (0.6,), (0.2,), gain_limit=norm / 2).gamma
    assert again is not None
    assert again < found.gamma  # the same gain by Theorem 1
    loose = design(system, (0.6,), (0.2,), gain_limit=1.1 * norm)
    np.testing.assert_array_equal(loose.K, plain.K)


def test_a_peak_from_an_offset_without_delay_is_the_start() -> None:
    """x' = -x, u = 3 x: |u| is 3 |x(0)| and no more; the proof is within 0.2 %."""
    system = DelaySystem([[-4.0]], [[1.0]], [[1.0]])
    bound = float(_peak(system, np.array([[3.0]]), offset=[0.5]).bounds[0])
    assert 1.5 <= bound <= 1.5 * 1.002


def test_a_peak_from_energy_is_that_of_the_gramian() -> None:
    """x' = -x + w reaches sup |x| = W / sqrt 2, in closed form; the proof is within 0.2 %."""
    system = DelaySystem([[-4.0]], [[1.0]], [[1.0]])
    bound = float(_peak(system, np.array([[3.0]]), energy=2.0).bounds[0])
    assert 3 * math.sqrt(2) <= bound <= 3 * math.sqrt(2) * 1.002
    both = float(_peak(system, np.array([[3.0]]), energy=2.0, offset=[0.5]).bounds[0])
    truth = 3 * math.sqrt(0.5**2 + 2.0)
    assert 0.9 * truth <= both <= 1.5 * truth


def test_peak_of_two_states_is_that_of_the_gramian() -> None:
    """Nominal, no delay: sup |K x| = W sqrt(K P K'), A P + P A' + C C' = 0, within 0.5 %."""
    A, C, K = np.array([[-1.0, 2.0], [0.0, -3.0]]), np.array([[0.0], [1.0]]), np.array([[1.0, 1.0]])
    system = DelaySystem(A, np.zeros((2, 1)), C)
    P = np.linalg.solve(np.kron(np.eye(2), A) + np.kron(A, np.eye(2)), -(C @ C.T).ravel()).reshape(
        2, 2
    )
    truth = math.sqrt(float((K @ P @ K.T)[0, 0]))
    bound = float(_peak(system, K, energy=1.0).bounds[0])
    assert truth <= bound <= 1.005 * truth


@pytest.mark.parametrize("any_age", [False, True])
def test_no_simulated_run_exceeds_the_proved_peak(any_age: bool) -> None:  # noqa: FBT001 - a case
    """Section 5, every corner of the offset, F turning, the age constant or a sawtooth."""
    s = paper_example.system()
    delay = Delay(0.3, s.delays[0].A, s.delays[0].H, any_age=any_age)
    system = DelaySystem(s.A, s.B, s.C, s.D, s.D1, s.D2, s.E, s.H, [delay])
    K = np.array([[0.6432, -0.5679]])
    proved = float(_peak(system, K, offset=[1.0, 0.5]).bounds[0])
    ages = [sawtooth(0.3, 0.25)] if any_age else [lambda _: 0.3]
    most = 0.0
    for corner in itertools.product((1.0,), (0.5, -0.5)):
        for speed, phase in itertools.product((0.0, 5.0), (0.0, math.pi)):
            F = turning(2, 2, speed, phase)
            u = integrate(system, K, np.array(corner), 3.0, ages=ages, F=F)[2]
            most = max(most, float(np.abs(u).max()))
    assert most <= proved <= 3 * most


def test_a_pulse_of_the_given_energy_stays_below_the_peak() -> None:
    """w = 1 for a quarter of a second has energy 1/2: u stays below what 1/2 allows."""
    system = paper_example.system()
    K = np.array([[0.6432, -0.5679]])
    proved = float(_peak(system, K, energy=0.5).bounds[0])
    u = integrate(
        system,
        K,
        np.zeros(2),
        2.0,
        ages=[lambda _: 0.3],
        F=turning(2, 2, 0.0),
        w=lambda t: np.array([1.0 if t < 0.25 else 0.0]),
    )[2]
    assert 0.05 * proved <= float(np.abs(u).max()) <= proved


def test_all_terms_of_the_functional_count_from_a_constant_start() -> None:
    """With a long constant delay Q is large: the level from the offset includes d x0'Q x0.

    x' = -2 x - x(t-1), held at 1: u = x never exceeds 1, and V without Q would prove less.
    """
    system = DelaySystem([[-2.0]], [[1.0]], delays=[Delay(1.0, [[-1.0]])])
    K = np.array([[1e-9]])
    found = _peak(system, K, offset=[1.0])
    bound = 1e9 * float(found.bounds[0])
    assert 1.0 <= bound <= 2.0
    Q = float(found.proof.unknowns["Q[0]"][0, 0])
    X = float(found.proof.unknowns["X"][0, 0])
    assert Q > 0
    assert bound**2 == pytest.approx(X * (1 + Q / X) / X, rel=1e-5)


def test_the_peak_is_designed_below_its_limit() -> None:
    """Below what the plain gain reaches; the flight respects it, gamma pays."""
    system = paper_example.system()
    plain = design(system, (0.6,), (0.2,), order=None)
    found = design(system, (0.6,), (0.2,), peak_control=0.2, offset=[1.0, 1.0], order=None)
    peak = found.guarantees.peak_control
    assert peak is not None
    assert float(peak.bounds[0]) <= 0.2
    assert plain.gamma is not None
    assert found.gamma is not None
    assert float(np.abs(plain.K).sum()) > 0.2  # u(0) alone
    assert found.gamma > plain.gamma
    assert found.abscissa < 0
    u = integrate(system, found.K, np.ones(2), 3.0, ages=[lambda _: 0.3], F=turning(2, 2, 2.0))[2]
    assert float(np.abs(u).max()) <= float(peak.bounds[0])


def test_units_do_not_matter() -> None:
    """Offset and limit a thousand times as large: the same proof in other units."""
    system = paper_example.system()
    K = np.array([[0.6432, -0.5679]])
    one = float(_peak(system, K, offset=[1.0, 0.5]).bounds[0])
    many = float(_peak(system, K, offset=[1e4, 0.5e4]).bounds[0])
    assert many == pytest.approx(1e4 * one, rel=1e-2)


def test_corners_stand_for_the_box() -> None:
    """One of each pair of opposite corners; sides of length zero have none."""
    assert sorted(offset_corners((2.0, 0.0, 3.0))) == [(2.0, 0.0, -3.0), (2.0, 0.0, 3.0)]
    assert offset_corners((0.0, 0.0)) == []


@pytest.mark.parametrize(
    ("asked", "word"),
    [
        ({"gain_limit": 0.0}, "gain_limit"),
        ({"gain_limit": math.inf}, "gain_limit"),
        ({"peak_control": -1.0, "offset": [1.0, 0.0]}, "peak_control"),
        ({"peak_control": [1.0, 2.0], "offset": [1.0, 0.0]}, "one per input"),
        ({"peak_control": 1.0}, "from nothing"),
        ({"peak_control": 1.0, "offset": [0.0, 0.0]}, "from nothing"),
        ({"peak_control": 1.0, "offset": [1.0]}, "one per state"),
        ({"peak_control": 1.0, "offset": [1.0, math.nan]}, r"offset\[1\]"),
        ({"peak_control": 1.0, "energy": -1.0}, "energy"),
        ({"offset": [1.0, 1.0]}, "peak_control as well"),
        ({"energy": 1.0}, "peak_control as well"),
    ],
)
def test_design_constraints_that_make_no_sense_are_refused(
    asked: dict[str, object], word: str
) -> None:
    """Each named, before anything is solved."""
    with pytest.raises(InputError, match=word):
        design(paper_example.system(), (0.6,), (0.2,), **asked)  # type: ignore[arg-type]


def test_a_given_gain_is_not_changed_to_meet_a_limit() -> None:
    """Its norm and its peak are said instead; where they are met, they are proved."""
    system = paper_example.system()
    K = [list(paper_example.PRINTED_K)]
    with pytest.raises(NotAchievableError, match=r"the norm of K is 0\.858"):
        design(system, (0.6,), (0.2,), gain=K, gain_limit=0.8, alternatives=False)
    with pytest.raises(NotAchievableError, match="the peaks proved are"):
        design(
            system, (0.6,), (0.2,), gain=K, peak_control=0.1, offset=[1.0, 1.0], alternatives=False
        )
    met = design(system, (0.6,), (0.2,), gain=K, gain_limit=0.9)
    assert met.guarantees.gain_limit is not None
    assert met.K.tolist() == K


def test_a_gain_limit_that_cannot_be_met_is_refused() -> None:
    """An unstable plant needs a gain of some size."""
    system = DelaySystem([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    assert float(np.abs(design(system, gain_limit=2.0).K).max()) <= 2.0
    with pytest.raises(NotAchievableError, match=r"\|K\| <= 0.9"):
        design(system, gain_limit=0.9, alternatives=False)
