"""Section 5 and Table 2: what is claimed of gamma, of the delay, and of every delay."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from truth.dde import solve

from cosim.core import silent
from cosim.hinf import hinf_norm
from cosim.hinf.delay_lti import ClosedLoop, close
from cosim.hinf.problem import with_delays
from cosim.models import Delay, DelaySystem, paper_example as example
from cosim.paper import Verdict, curves, every_delay, figure_rows, simulate, table_2


def test_a_gain_and_gamma_for_every_delay_survive_uncertainty_and_delay() -> None:
    """Exact norms at drawn constant F with |F| <= 1 and delays up to 50 s stay below gamma."""
    system = example.system()
    found = every_delay(system)
    assert found is not None
    assert 5.0 < found.gamma < 5.001
    rng = np.random.default_rng(8)
    for d in (0.0, 0.3, 1.2, 7.0, 50.0):
        F = rng.standard_normal((2, 2))
        F /= max(np.linalg.norm(F, 2), 1.0)
        dA, dA1 = (system.E @ F @ np.array(H) for H in (example.H, example.H1))
        changed = DelaySystem(
            system.A + dA,
            system.B,
            system.C,
            system.D,
            system.D1,
            system.D2,
            delays=[Delay(d, np.array(example.A1) + dA1)],
        )
        norm = hinf_norm(close(changed, found.K))
        assert norm is not None
        assert norm.value <= found.gamma


def test_a_gain_that_fails_at_some_delay_is_not_certified_for_every_delay() -> None:
    """A gain that makes the loop unstable, and x' = -x(t-d), stable for d < pi/2 alone."""
    assert every_delay(example.system(), [[-50.0, 0.0]]) is None
    one, none = [[1.0]], [[0.0]]
    lag = DelaySystem(none, none, one, one, none, none, none, one, [Delay(0.1, [[-1.0]], one)])
    assert every_delay(lag, none) is None


def test_printed_gain_for_every_delay_is_what_theorem_1_gives() -> None:
    """5.0455, the figure of Theorem 1 at d = 0.3 (published with the corrected text)."""
    found = every_delay(example.system(), [example.PRINTED_K])
    assert found is not None
    assert found.gamma == pytest.approx(5.0455, abs=1e-4)
    assert found.K.tolist() == [list(example.PRINTED_K)]


def test_the_columns_up_to_the_norm_of_d1_are_impossible_whatever_the_delay() -> None:
    """v' Omega v is |D1|^2 / gamma - gamma for a vector v, and |D1|^2 = 4^2 + 3^2."""
    four, five = table_2(None, silent, gammas=(4.0, 5.0))
    assert [entry.witness for entry in (four, five)] == [Fraction(25, 4) - 4, 0]
    assert {entry.verdict for entry in (four, five)} == {Verdict.IMPOSSIBLE}


@pytest.mark.slow
def test_table_2_where_it_is_impossible_and_where_it_is_not() -> None:
    """gamma = 4: no delay. gamma = 6: 1.0428 s at the printed k1, k2, then to the limit."""
    reported: list[str] = []
    everywhere = every_delay(example.system())
    none, six, eight = table_2(
        everywhere, lambda what, _: reported.append(what), 3.0, (4.0, 6.0, 8.0)
    )
    assert len(reported) == 3
    assert none.verdict is Verdict.IMPOSSIBLE
    assert (none.corrected, none.searched, none.bessel_legendre) == (None, None, None)
    assert not none.every_delay
    assert not none.limit_reached
    assert six.corrected == pytest.approx(1.0428, abs=6e-5)
    assert six.witness == Fraction(25, 6) - 6
    assert six.refuted_at is not None
    assert six.corrected is not None
    assert six.corrected < six.refuted_at < six.printed
    assert six.verdict is Verdict.DOES_NOT
    assert "Infeasible" in six.why
    assert (six.searched, six.limit_reached) == (3.0, True)
    assert (six.bessel_legendre, six.bessel_legendre_limit_reached) == (3.0, True)
    assert six.every_delay
    assert (eight.k1, eight.k2) == (six.k1, six.k2)
    assert "not the greatest" in eight.why
    entry_json = six.to_json()
    assert entry_json["feasible"] is True
    assert entry_json["verdict"] == "does not hold"


def test_simulated_run_is_the_solution_of_the_delay_equation() -> None:
    """Against an integrator that shares no code: state and accumulated gain after 6 s."""
    A, A1, B, C = (np.array(M) for M in (example.A, example.A1, example.B, example.C))
    D, D1, D2, E = (np.array(M) for M in (example.D, example.D1, example.D2, example.E))
    H, H1, K = np.array(example.H), np.array(example.H1), np.array([example.PRINTED_K])

    def rate(t: float, y: np.ndarray, late: list[np.ndarray]) -> np.ndarray:
        x, xd, w, f = y[:2], late[0][:2], np.array([math.sin(2 * t)]), 0.5 * math.sin(t)
        slope = (A + f * E @ H + B @ K) @ x + (A1 + f * E @ H1) @ xd + C @ w
        z = (D + D2 @ K) @ x + D1 @ w
        return np.concatenate([slope, [z @ z, w @ w]])

    truth = solve(rate, (10.0, 10.0, 0.0, 0.0), [0.3], 6.0)(6.0)
    run = simulate(initial=(10.0, 10.0), frequency=2.0, amplitude=0.5, end=6.0, points=121)
    assert np.allclose(run.x[-1], truth[:2], rtol=0, atol=1e-7)
    assert run.u[-1] == pytest.approx(float((K @ truth[:2])[0]), abs=1e-7)
    assert run.gain == pytest.approx(math.sqrt(truth[2] / truth[3]), rel=1e-6)


def test_figures_are_not_comparable_and_ours_start_where_the_paper_does() -> None:
    drawn = curves()
    assert drawn.run.x[0].tolist() == [10.0, 10.0]
    assert drawn.run.u[0] == pytest.approx(10 * (0.6432 - 0.5679))
    assert {row.verdict for row in figure_rows(drawn)} == {Verdict.NOT_COMPARABLE}
    assert len(drawn.to_json()["t"]) == len(drawn.to_json()["x1"])


def test_norm_above_the_claim_is_attained_at_its_frequency() -> None:
    """|G(j omega)| of the printed loop, written out here, exceeds 5 at 22.905 rad/s."""
    s = 1j * 22.905
    A_K = np.array(example.A) + np.array(example.B) @ np.array([example.PRINTED_K])
    D_K = np.array(example.D) + np.array(example.D2) @ np.array([example.PRINTED_K])
    M = s * np.eye(2) - A_K - np.array(example.A1) * np.exp(-0.3 * s)
    G = D_K @ np.linalg.solve(M, np.array(example.C)) + np.array(example.D1)
    assert np.linalg.norm(G, 2) == pytest.approx(5.0276, abs=1e-4)
    loop = close(with_delays(example.system(), [0.3]), [example.PRINTED_K])
    assert isinstance(loop, ClosedLoop)
    norm = hinf_norm(loop)
    assert norm is not None
    assert norm.value == pytest.approx(float(np.linalg.norm(G, 2)), abs=1e-6)
