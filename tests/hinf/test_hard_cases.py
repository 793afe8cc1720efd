"""Numbers far apart, delays of zero and of hours, and all that cannot be had: by name."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from shared import sampled, slow_share_of

from cosim.core import InputError, NotAchievableError
from cosim.hinf import Result, auv_system, check_certificate, design, greatest_delay
from cosim.hinf.lmi import Answer, Problem, scaling_of
from cosim.hinf.problem import DEFAULT_K1, DEFAULT_K2, with_delays
from cosim.hinf.synthesis import unstabilisable_root
from cosim.hinf.theorems import Scalars
from cosim.models import Delay, DelaySystem, paper_example

Array = NDArray[np.float64]


def _in_units(
    s: DelaySystem,
    state: list[float],
    *,
    control: float = 1.0,
    second: float = 1.0,
    w: float = 1.0,
    z: float = 1.0,
) -> DelaySystem:
    """The same system, its states, input, time, w and z counted in other units."""
    S, T = np.array(state), second
    rows = T / S[:, None]
    delays = [Delay(x.d / T, rows * x.A * S, x.H * S, x.feedback, x.any_age) for x in s.delays]
    return DelaySystem(
        rows * s.A * S,
        rows * s.B * control,
        w * rows * s.C,
        z * s.D * S,
        w * z * s.D1,
        z * s.D2 * control,
        rows * s.E,
        s.H * S,
        delays,
        s.name,
    )


def _least(system: DelaySystem, k1: Any, k2: Any) -> float:
    p = Scalars(tuple(k1), tuple(k2), tuple(delay.d for delay in system.delays))
    answer = Problem(system).least_gamma(p)
    assert isinstance(answer, Answer)
    return answer.value


@pytest.mark.parametrize("name", ["paper", "auv"])
def test_inner_units_are_exact_and_near_one(name: str) -> None:
    """Powers of two alone: forth and back is the same double, and entries come near one."""
    system = paper_example.system() if name == "paper" else auv_system()
    odd = _in_units(system, [10.0 ** ((-1) ** i * 6) for i in range(len(system.A))], second=1e-4)
    units = scaling_of(odd)
    for values in (units.state, units.input, units.T, units.a, units.c):
        assert (np.frexp(values)[0] == 0.5).all()
    inner = units.system(odd)
    back = inner.A * units.state[:, None] / units.state / units.T
    np.testing.assert_array_equal(back, odd.A)

    def spread(s: DelaySystem) -> float:
        """Of the largest entries of all matrices that are there."""
        largest = [float(np.abs(M).max()) for M in (s.A, s.B, s.C, s.D, s.D2, s.E, s.H) if M.any()]
        return max(largest) / min(largest)

    assert spread(odd) > 1e5
    assert spread(inner) < 1e2


@pytest.mark.parametrize(
    ("state", "others"),
    [
        ([1e-3, 1e3], {}),
        ([1e-6, 1e6], {}),
        ([1.0, 1.0], {"second": 1e-6}),
        ([1.0, 1.0], {"second": 86400.0}),
        ([1.0, 1.0], {"control": 1e6}),
        ([1e3, 1e-3], {"w": 1e4, "z": 1e3, "control": 1e-6, "second": 1e3}),
    ],
)
def test_the_least_gamma_does_not_depend_on_units(
    state: list[float], others: dict[str, float]
) -> None:
    """Section 5 in millimetres, kilometres, microseconds, days, meganewtons: 5.0132 w z."""
    system = _in_units(paper_example.system(), state, **others)
    T = others.get("second", 1.0)
    least = _least(system, [0.6 * T], [0.2 * T])
    assert least / (others.get("w", 1.0) * others.get("z", 1.0)) == pytest.approx(5.0132, abs=5e-5)


@pytest.mark.slow
def test_the_vehicle_in_millimetres_kilometres_and_degrees() -> None:
    """Eight states over nine decades: the same bound, certified; every entry of K kept."""
    units = [1e-3, 1e3, 1.0, np.pi / 180, 1e-3, 1e3, 1.0, np.pi / 180]
    system = _in_units(auv_system(), units)
    found = design(system, DEFAULT_K1, DEFAULT_K2, order=None)
    assert found.gamma == pytest.approx(3.4187, abs=2e-4)
    assert check_certificate(found.certificate).valid
    usual = design(auv_system(), DEFAULT_K1, DEFAULT_K2, order=None)
    np.testing.assert_allclose(found.K / np.array(units), usual.K, rtol=2e-2, atol=1e-3)


@pytest.mark.slow
def test_rates_twelve_decades_apart() -> None:
    """1e6 1/s beside 1e-6 1/s: the certificate stands, whatever figures can be computed."""
    system = DelaySystem(
        np.diag([-1e6, -1e-6]),
        [[1e6], [1e-6]],
        [[1e6], [1e-6]],
        [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]],
        None,
        [[0.0], [0.0], [1.0]],
        delays=[Delay(0.1, np.zeros((2, 2)))],
    )
    found = design(system, (-1.0,), (1.0,))
    assert check_certificate(found.certificate).valid


def theorem_2(system: DelaySystem, k1: tuple[float, ...], k2: tuple[float, ...]) -> Result:
    """The design by Theorem 2 at these k1, k2; without a control, of one that does nothing."""
    if not system.B.size:
        nothing = np.zeros((len(system.A), 1)), np.zeros((len(system.D), 1))
        system = replace(system, B=nothing[0], D2=nothing[1])
    return design(system, k1, k2, order=None, search=False)


def test_a_delay_of_zero_is_no_delay() -> None:
    """x' = -x + w/2 x(t), z = x: gamma = 1/|A + A1| = 2, by d = 0 and without the delay."""
    late = DelaySystem([[-1.0]], C=[[1.0]], D=[[1.0]], delays=[Delay(0.0, [[0.5]])])
    none = DelaySystem([[-0.5]], C=[[1.0]], D=[[1.0]])
    for system, k in ((late, (1.0,)), (none, ())):
        found = theorem_2(system, tuple(-x for x in k), k)
        assert found.gamma == pytest.approx(2.0, rel=1e-3)
        assert found.exact_norm == pytest.approx(2.0)
        assert check_certificate(found.certificate).valid


@pytest.mark.slow
@pytest.mark.parametrize("d", sampled([1e4, 1e5], 1))
def test_a_delay_of_hours(d: float) -> None:
    """Section 5 at gamma = 6 with k1 = -.1/d, k2 = .5/d: certified, whatever can be counted."""
    system = with_delays(paper_example.system(), [d])
    found = design(system, (-0.1 / d,), (0.5 / d,), gamma=6.0)
    assert found.gamma is not None
    assert found.gamma <= 6.0
    assert found.abscissa is None or found.abscissa < 0
    assert check_certificate(found.certificate).valid


@pytest.mark.slow
def test_the_greatest_delay_up_to_hours() -> None:
    """--delay-limit 1e4, k1 and k2 searched."""
    found = greatest_delay(paper_example.system(), 6.0, (0.6,), (0.2,), search=True, limit=1e4)
    assert (found.delay, found.limit_reached) == (1e4, True)
    assert check_certificate(found.result.certificate).valid


@pytest.mark.parametrize(
    ("system", "root"),
    [
        (DelaySystem(np.diag([1.0, -1.0]), [[0.0], [1.0]], np.eye(2), np.eye(2)), 1.0),
        # s = e^{-s} / 2 by Lambert's W: 0.351733711249
        (
            DelaySystem(
                np.diag([0.0, -1.0]),
                [[0.0], [1.0]],
                np.eye(2),
                np.eye(2),
                delays=[Delay(1.0, np.diag([0.5, 0.0]))],
            ),
            0.351733711249,
        ),
        # a heading that no rudder turns: an integrator stays at 0
        (DelaySystem([[0.0, 1.0], [0.0, -0.2]], np.zeros((2, 1)), [[0], [1.0]], [[1.0, 0]]), 0.0),
        # an oscillation beside the vehicle's surge
        (
            DelaySystem(
                [[-0.1, 0, 0], [0, 0, 2.0], [0, -2.0, 0]],
                [[1.0], [0], [0]],
                np.eye(3),
                np.eye(3),
                delays=[Delay(0.5, np.zeros((3, 3)), feedback=True)],
            ),
            2.0j,
        ),
    ],
)
def test_a_root_that_no_input_moves_is_named(system: DelaySystem, root: complex) -> None:
    """Hautus' test, against roots in closed form; in a design and in a greatest delay."""
    found = unstabilisable_root(system)
    assert found is not None
    assert complex(found.real, abs(found.imag)) == pytest.approx(root, abs=1e-8)
    N = len(system.delays)
    with pytest.raises(NotAchievableError, match=r"no gain stabilises.*root at"):
        design(system, (-1.0,) * N, (1.0,) * N, alternatives=False)
    if N:
        with pytest.raises(NotAchievableError, match="no gain stabilises"):
            greatest_delay(system, 100.0, (-1.0,), (1.0,))


@pytest.mark.slow
def test_stabilisable_system_is_not_reported() -> None:
    """An unstable root that the input reaches, and the vehicle."""
    assert unstabilisable_root(DelaySystem([[1.0]], [[1.0]])) is None
    assert unstabilisable_root(auv_system()) is None


def test_infeasible_k1_k2_are_not_reported_as_unstabilisable() -> None:
    """x' = x + u(t - .3): u = -2x would do, but not k1 = -1, k2 = 1; proved for any gamma."""
    system = DelaySystem(
        [[1.0]], [[1.0]], [[1.0]], [[1.0]], delays=[Delay(0.3, [[0.0]], feedback=True)]
    )
    with pytest.raises(NotAchievableError, match="no solution for any gamma") as refused:
        design(system, (-1.0,), (1.0,), order=None, search=False, alternatives=False)
    proof = check_certificate(refused.value.certificate)
    assert proof.valid
    assert proof.claim["gamma"] is None


@pytest.mark.parametrize("delays", sampled([[], [Delay(0.3, [[0.5]])]], 1))
def test_control_without_weight_has_no_least_gamma(delays: list[Delay]) -> None:
    """x' = x + u + w, z = x: any gamma can be achieved, so the user must choose one."""
    system = DelaySystem([[1.0]], [[1.0]], [[1.0]], [[1.0]], delays=delays)
    k = (1.0,) * len(delays)
    with pytest.raises(NotAchievableError, match="there is no least gamma") as refused:
        design(system, tuple(-x for x in k), k, alternatives=False)
    assert "D2" in str(refused.value)
    found = design(system, tuple(-x for x in k), k, gamma=0.1)
    assert found.gamma == 0.1
    assert check_certificate(found.certificate).valid


@pytest.mark.parametrize("zero", ["C", "D"])
def test_a_gain_that_is_zero_has_no_least_gamma(zero: str) -> None:
    """z does not depend on w: an error, not a design."""
    C, D = ([[0.0]], [[1.0]]) if zero == "C" else ([[1.0]], [[0.0]])
    system = DelaySystem([[-1.0]], [[1.0]], C, D, delays=[Delay(0.3, [[0.5]])])
    with pytest.raises(NotAchievableError, match="no gain from w to z"):
        design(system, (-1.0,), (1.0,), alternatives=False)


@pytest.mark.parametrize(
    ("system", "norm"),
    [
        (DelaySystem([[-1.0]], None, [[1.0]], [[1.0]], delays=[Delay(0.3, [[0.5]])]), 2.0),
        (DelaySystem([[-1.0]], [[0.0]], [[1.0]], [[1.0]], delays=[Delay(0.3, [[0.5]])]), 2.0),
        (DelaySystem([[-2.0]], None, [[3.0]], [[1.0]], delays=[Delay(0.3, [[0.0]])]), 1.5),
    ],
)
def test_one_state_no_input_no_uncertainty_zero_matrices(system: DelaySystem, norm: float) -> None:
    """x' = a x + a1 x(t-d) + c w: gamma = c / (-a - a1) for a1 >= 0, the least there is."""
    found = theorem_2(system, (-1.0,), (1.0,))
    assert found.gamma is not None
    assert norm <= found.gamma < norm * (1 + 1e-4)
    assert check_certificate(found.certificate).valid


def test_a_pure_integrator_over_a_link() -> None:
    """A = A1 = 0: no rate of its own; the delay gives the scale."""
    system = DelaySystem(
        [[0.0]],
        [[1.0]],
        [[1.0]],
        [[1.0], [0.0]],
        None,
        [[0.0], [1.0]],
        delays=[Delay(0.3, [[0.0]], feedback=True)],
    )
    found = design(system, (-1.0,), (1.0,))
    assert found.exact_norm is not None
    assert found.gamma is not None
    assert found.exact_norm <= found.gamma
    assert check_certificate(found.certificate).valid


def test_an_uncertainty_of_zero_is_none() -> None:
    """E = H = 0: the same least gamma as without them."""
    parts: dict[str, Any] = {
        "A": [[-1.0]],
        "B": [[1.0]],
        "C": [[1.0]],
        "D": [[1.0], [0.0]],
        "D2": [[0.0], [1.0]],
        "delays": [Delay(0.3, [[0.5]])],
    }
    zero = _least(DelaySystem(**parts, E=[[0.0]], H=[[0.0]]), (-1.0,), (1.0,))
    assert zero == pytest.approx(_least(DelaySystem(**parts), (-1.0,), (1.0,)), rel=1e-6)


@pytest.mark.parametrize(
    ("system", "k1", "k2", "where"),
    [
        (DelaySystem([[-1e200]], [[1.0]], [[1.0]], [[1.0]]), (), (), "A"),
        (DelaySystem([[-1e-200]], [[1.0]], [[1.0]], [[1.0]]), (), (), "A"),
        (paper_example.system(), (1e300,), (1.0,), "k1"),
        (paper_example.system(), (1.0,), (1e-300,), "k2"),
        (paper_example.system(1e200), (1.0,), (1.0,), r"delays\[0\].d"),
    ],
)
def test_numbers_too_far_from_one_are_refused(
    system: DelaySystem, k1: tuple[float, ...], k2: tuple[float, ...], where: str
) -> None:
    """No overflow and no wrong result: the error names the number."""
    with pytest.raises(InputError, match=f"{where}: a number is too far from one"):
        design(system, k1, k2)


@pytest.mark.parametrize("k2", [0.0, -0.0])
def test_k2_of_zero_is_refused(k2: float) -> None:
    """Theorem 2 divides by it."""
    for ask in (design, greatest_delay):
        arguments = (6.0, (0.6,), (k2,)) if ask is greatest_delay else ((0.6,), (k2,))
        with pytest.raises(InputError, match="k2 must not be zero"):
            ask(paper_example.system(), *arguments)  # type: ignore[operator]


@pytest.mark.parametrize("case", slow_share_of(range(12)))
def test_random_systems_end_with_a_proof_or_an_error(case: int) -> None:
    """Random systems of odd sizes and scales: a valid certificate, or one of the errors."""
    rng = np.random.default_rng(500 + case)
    n, m = int(rng.integers(1, 4)), int(rng.integers(0, 3))
    scale = 10.0 ** rng.integers(-4, 5, size=n)

    def r(*shape: int) -> Array:
        return np.asarray(rng.standard_normal(shape) * (rng.random(shape) < 0.7))

    A, A1 = (x * scale[:, None] / scale for x in (r(n, n), 0.3 * r(n, n)))
    system = DelaySystem(
        A,
        r(n, m) * scale[:, None] if m else None,
        r(n, 1) * scale[:, None],
        r(2, n) / scale,
        delays=[Delay(float(10.0 ** rng.integers(-3, 3)), A1, feedback=bool(case % 3 == 0))],
    )
    try:
        proof = theorem_2(system, (-0.5,), (0.5,)).certificate
    except NotAchievableError as refused:
        proof = refused.certificate
    assert proof is None or check_certificate(proof).valid


def test_a_search_that_begins_at_the_edge_of_what_is_solved() -> None:
    """The first k1, k2 have an answer, and their rounding by exp(log(.)) has none."""
    late = paper_example.system()
    delays = (*late.delays, Delay(0.06, np.zeros((2, 2)), None, feedback=True, any_age=True))
    system = DelaySystem(late.A, late.B, late.C, late.D, late.D1, late.D2, late.E, late.H, delays)
    found = design(system, gain=[[3.216, -2.8395]])
    assert found.gamma is not None
    assert 5.557 < found.gamma < 8.0  # above the exact norm
    assert check_certificate(found.certificate).valid
