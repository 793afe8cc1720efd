"""Published examples, held against the exact truth.

Sources: K. Gu, V. Kharitonov, J. Chen, Stability of Time-Delay Systems, 2003 (exact intervals,
in `SECOND_ORDER` the one that needs its delay); A. Seuret, F. Gouaisbaut, Syst. Control Lett.
81, 2015 (the ladder of orders on it); E. Fridman, U. Shaked, IEEE Trans. Autom. Control 47,
2002 (`FRIDMAN_SHAKED`, its exact norm). What is known in closed form is computed here.
"""

from __future__ import annotations

import numpy as np
import pytest
from truth_of_loops import abscissa, first_loss, loop_of, norm

from cosim.hinf import analyse, certified_delay, check_certificate, design
from cosim.hinf.problem import with_delays
from cosim.models import Delay, DelaySystem

SCALAR = DelaySystem([[0.0]], delays=[Delay(1.0, [[-1.0]])])
SECOND_ORDER = DelaySystem([[0, 1], [-2, 0.1]], delays=[Delay(1.0, [[0, 0], [1, 0]])])
FRIDMAN_SHAKED = DelaySystem(
    [[-2, 0], [0, -0.9]], C=[[-0.5], [1]], D=[[1, 0]], delays=[Delay(0.846, [[-1, 0], [-1, -1]])]
)
FRIDMAN_SHAKED_DESIGN = DelaySystem(
    [[0, 0], [0, 1]],
    [[0], [1]],
    [[1], [1]],
    [[0, 1], [0, 0]],
    None,
    [[0], [0.1]],
    delays=[Delay(0.999, [[-1, -1], [0, -0.9]])],
)


@pytest.mark.parametrize(("order", "published"), [(0, np.sqrt(2)), (1, None), (2, None)])
def test_a_pure_delayed_feedback(order: int, published: float | None) -> None:
    """x' = -x(t-d) is stable for d < pi/2; Jensen's condition ends at sqrt 2, in closed form.

    At order 0 it is [[q-r, r-p], [r-p, d^2 r-q-r]] < 0, best at p = r, q -> r: d^2 < 2.
    """
    found = certified_delay(SCALAR, order=order)
    assert found.delay is not None
    assert found.delay < np.pi / 2
    if published is not None:
        assert found.delay == pytest.approx(published, rel=2e-6)
    else:
        assert found.delay > (1.5674, 1.5707)[order - 1]


@pytest.mark.parametrize(
    ("order", "ladder"),
    [(1, (0.1006, 1.5405)), (2, (0.1002, 1.7122)), (3, (0.1002, 1.7177))],
)
def test_a_loop_that_needs_its_delay(order: int, ladder: tuple[float, float]) -> None:
    """Stable for 0.100168 < d < 1.7178 alone: the published ladder, inside, nothing outside."""
    exact = (0.10016827, 1.71785818)
    for end in exact:
        assert abs(abscissa(loop_of(SECOND_ORDER).at(0, end))) < 1e-8
    found = certified_delay(SECOND_ORDER, order=order)
    assert found.delay is not None
    assert ladder[1] <= found.delay < exact[1]
    assert not analyse(with_delays(SECOND_ORDER, [found.delay]), order=0).certified
    assert analyse(with_delays(SECOND_ORDER, [ladder[0]]), order=order).certified
    for d in (0.1001, 1.7179):
        assert not analyse(with_delays(SECOND_ORDER, [d]), order=order).certified


def test_a_bounded_real_lemma() -> None:
    """The norm at d = 0.846 is 0.2364; the orders come down to it, and stay above."""
    exact = norm(loop_of(FRIDMAN_SHAKED))
    assert exact == pytest.approx(0.2364, abs=5e-5)
    found = [analyse(FRIDMAN_SHAKED, order=order) for order in (0, 1, 2)]
    gammas = [float(one.gamma or 0) for one in found]
    assert all(check_certificate(one.certificate).valid for one in found)
    assert gammas[0] == pytest.approx(0.2619, abs=1e-4)
    assert exact < gammas[2] < gammas[1] < gammas[0]
    assert gammas[2] < 1.0001 * exact


@pytest.mark.parametrize(("order", "bound"), [(None, 0.63), (0, 0.14), (1, 0.1287), (2, 0.1287)])
def test_a_state_feedback(order: int | None, bound: float) -> None:
    """Published: 0.1287, by a descriptor method with one scalar; no gain has less than 0.1.

    At high frequency z = (0, 0.1 u) and x follow w, and u = -w at the best.
    """
    made = design(FRIDMAN_SHAKED_DESIGN, [-0.5], [1.0], order=order)
    loop = loop_of(FRIDMAN_SHAKED_DESIGN, made.K)
    assert 0.1 < norm(loop) < float(made.gamma or 0) < bound
    assert first_loss(loop, 0) > 0.999
