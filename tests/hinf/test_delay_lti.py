"""`DelayLTI`: models in and out, series, parallel and feedback connections, all without loss."""

from __future__ import annotations

import re
import sys
from typing import Any

import control
import numpy as np
import pytest
import scipy.signal

from cosim.core import InputError
from cosim.hinf import (
    Delay,
    DelayLTI,
    DelaySystem,
    characteristic_roots,
    hinf_norm,
    lti,
    spectral_abscissa,
)
from cosim.hinf.delay_lti import append, close, dead_time, exp, feedback, parallel, series
from cosim.models import paper_example

POINTS = np.array([0.3j, 2.0j, 0.5 + 1.0j, -0.2 + 7.0j])
NUM, DEN = [1.0, 3.0], [1.0, 0.4, 2.0]


def rational(s: Any) -> Any:
    return np.polyval(NUM, s) / np.polyval(DEN, s)


@pytest.mark.parametrize(
    "model",
    [
        control.tf(NUM, DEN),
        control.ss(control.tf(NUM, DEN)),
        scipy.signal.lti(NUM, DEN),
        scipy.signal.StateSpace(*scipy.signal.tf2ss(NUM, DEN)),
        scipy.signal.ZerosPolesGain(*scipy.signal.tf2zpk(NUM, DEN)),
    ],
    ids=lambda model: type(model).__name__,
)
def test_models_of_other_libraries_come_in_and_take_part(model: Any) -> None:
    """On either side of *, + and - as well."""
    expected = rational(POINTS) * np.exp(-0.7 * POINTS)
    for found in (model * dead_time(0.7), dead_time(0.7) * model, lti(model, input_delay=0.7)):
        assert isinstance(found, DelayLTI)
        np.testing.assert_allclose(found.value(POINTS), expected, rtol=1e-13)
    np.testing.assert_allclose((1 + model * dead_time(0.7)).value(POINTS), 1 + expected, rtol=1e-13)
    np.testing.assert_allclose(
        (model - dead_time(0.7)).value(POINTS), rational(POINTS) - np.exp(-0.7 * POINTS), rtol=1e-12
    )


def test_mimo_with_a_delay_of_its_own_in_every_entry() -> None:
    """Wood and Berry's column; and its loop with a matrix of gains."""
    num = [[[12.8], [-18.9]], [[6.6], [-19.4]]]
    den = [[[16.7, 1], [21, 1]], [[10.9, 1], [14.4, 1]]]
    late = np.array([[1.0, 3.0], [7.0, 3.0]])
    G = lti(control.tf(num, den), io_delay=late)

    def by_hand(s: complex) -> Any:
        entry = [
            [np.polyval(num[i][j], s) / np.polyval(den[i][j], s) for j in (0, 1)] for i in (0, 1)
        ]
        return np.array(entry) * np.exp(-late * s)

    K = np.array([[0.1, 0.02], [0.0, -0.05]])
    T = feedback(G * K, np.eye(2))
    assert (G.order, G.inputs, G.outputs) == (4, 2, 2)
    for s in POINTS:
        np.testing.assert_allclose(G.value(s), by_hand(s), rtol=1e-12)
        L = by_hand(s) @ K
        np.testing.assert_allclose(
            T.value(s), np.linalg.solve(np.eye(2) + L, L), rtol=1e-11, atol=1e-14
        )
    np.testing.assert_allclose(G[1, 0].value(1j), by_hand(1j)[1, 0], rtol=1e-12)


def test_connections_are_those_of_the_transfer_functions() -> None:
    """Series in the order of the signal, parallel, append, feedback of either sign and with H."""
    G = lti(control.tf([1], [1, 1])) * dead_time(0.3)
    H = lti(control.tf([2], [0.1, 1]), output_delay=0.2)
    for s in POINTS:
        g, h = G.value(s), H.value(s)
        assert series(G, H).value(s) == pytest.approx(g * h, rel=1e-13)
        assert parallel(G, H, 1).value(s) == pytest.approx(g + h + 1, rel=1e-13)
        assert G.feedback(H).value(s) == pytest.approx(g / (1 + g * h), rel=1e-12)
        assert feedback(G, H, 1).value(s) == pytest.approx(g / (1 - g * h), rel=1e-12)
        np.testing.assert_allclose(append(G, H).value(s), np.diag([g, h]), rtol=1e-13)
        assert (-G / 4).value(s) == pytest.approx(-g / 4, rel=1e-14)
    two = lti(np.eye(2)) * G  # one system for every signal
    np.testing.assert_allclose(two.value(1j), G.value(1j) * np.eye(2), rtol=1e-14)


def test_delays_in_series_are_one_and_no_delay_is_none() -> None:
    """Channels are not multiplied by connections."""
    late = dead_time(0.1) * dead_time(0.2) * dead_time(0.0)
    assert late.delays.tolist() == pytest.approx([0.3])
    assert dead_time(0.0).delays.size == 0
    assert (G := lti(control.tf([1], [1, 1]), input_delay=1)).delays.tolist() == [1.0]
    assert (G + G).delays.size == 1  # both wait for the same input
    assert exp(-0.5 * control.tf("s")).delays.tolist() == [0.5]
    # a loop through a delay of zero is an algebraic one, and is solved
    assert (0.5 * dead_time(0.0)).feedback().value(1j) == pytest.approx(1 / 3)


def test_systems_of_this_package_come_in_and_go_back() -> None:
    """A DelaySystem, with a gain or with its controls as inputs; roots and norm survive."""
    system = paper_example.system()
    K = np.array([paper_example.PRINTED_K])
    loop = close(system, K)
    for found in (lti(system, gain=K), lti(loop)):
        np.testing.assert_allclose(found.value(2j), loop.transfer(2.0), rtol=1e-13)
    opened = lti(system)
    assert opened.inputs == system.C.shape[1] + system.B.shape[1]
    np.testing.assert_allclose(
        opened.value(2j)[:, :1], close(system, 0 * K).transfer(2.0), rtol=1e-13
    )
    late = DelaySystem([[-1.0]], C=[[1.0]], D=[[2.0]], delays=[Delay(0.4, [[-0.5]])])
    again = lti(late).system()
    assert (again.delays[0].d, again.delays[0].A.tolist()) == (0.4, [[-0.5]])
    # an input that is late, and an output that is not: the transposed system
    T = (2 * control.tf([1], [1, 3, 2]) * dead_time(0.3)).feedback(control.tf([1, 1], [1, 5]))
    assert lti(T.system()).norm().value == pytest.approx(T.norm().value, rel=1e-9)  # type: ignore[union-attr]


def test_models_go_out_to_python_control_and_scipy() -> None:
    """An FRD is exact; Pade of order n is control's own; without delays nothing is lost."""
    T = (2 * control.tf([1], [1, 1]) * dead_time(0.5)).feedback()
    omega = np.array([0.5, 3.0])
    np.testing.assert_allclose(np.ravel(T.to_control(omega=omega)(1j * omega)), T.value(1j * omega))
    theirs = control.feedback(control.tf([2], [1, 1]) * control.tf(*control.pade(0.5, 4)))
    for found in (T.to_control(pade=4)(2j), T.pade(4).value(2j)):
        assert found == pytest.approx(theirs(2j), rel=1e-10)
    scipy_model = T.to_scipy(pade=4)
    assert isinstance(scipy_model, scipy.signal.StateSpace)
    plain = lti(control.tf(NUM, DEN))
    assert plain.to_control()(2j) == pytest.approx(rational(2j), rel=1e-13)


def test_functions_of_python_control_answer_or_refuse() -> None:
    """None takes the system for an empty one; what they compute is that of the delays."""
    G = 2 * control.tf([1], [1, 1]) * dead_time(0.5)
    omega = np.array([0.5, 3.0])
    exact = 2 * np.exp(-0.5j * omega) / (1 + 1j * omega)
    size, phase, _ = control.frequency_response(G, omega)
    np.testing.assert_allclose(size * np.exp(1j * phase), exact, rtol=1e-12)
    assert control.dcgain(G) == pytest.approx(2.0)
    assert (control.feedback(G, 1) * 1).delays.tolist() == [0.5]
    for name in (
        *("ss", "tf", "poles", "zeros", "bode_plot", "nyquist_plot", "step_response", "margin"),
        *("stability_margins", "forced_response", "norm", "ss2tf", "damp", "gram", "root_locus"),
    ):
        with pytest.raises((AttributeError, TypeError, ValueError, NotImplementedError)):
            getattr(control, name)(G)
    with pytest.raises(InputError, match="infinitely many poles"):
        control.poles(G)
    assert control.poles(lti(control.tf([1], [1, 1]))).tolist() == [-1.0]


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda: lti("plant"), "not a model.*str"),
        (lambda: lti(control.tf([1], [1, 1], 0.1)), "discrete.*0.1"),
        (lambda: lti(control.tf([1, 0], [1])), "improper.*fast pole"),
        (lambda: dead_time(-1.0), "not a delay.*-1"),
        (lambda: lti(1.0, input_delay=[1.0, 2.0]), "input_delay.*1 numbers"),
        (lambda: lti(np.eye(2), io_delay=[[1.0]]), "io_delay.*2 by 2"),
        (lambda: exp(control.tf("s")), "tau >= 0"),
        (lambda: exp(1.0), "dead_time"),
        (lambda: series(np.eye(2), np.eye(3)), "do not fit in series"),
        (lambda: parallel(np.eye(2), np.eye(3)), "different sizes"),
        (lambda: feedback(np.eye(2), np.eye(3)), "does not fit.*3 inputs"),
        (lambda: feedback(-1.0, 1.0), "no solution"),
        (lambda: dead_time(1.0) / dead_time(1.0), "feedback"),
        (lambda: dead_time(1.0).to_control(), "order of a Pade"),
        (lambda: (0.5 * dead_time(1.0)).feedback().system(), "neutral"),
        (lambda: dead_time(1.0).system(), "no DelaySystem"),
        (lambda: lti(control.tf([1], [1, 0])).value(0.0), "pole"),
    ],
)
def test_what_cannot_be_is_refused_in_words(ask: Any, words: str) -> None:
    """What, where, what was expected, and a way out."""
    with pytest.raises(InputError) as caught:
        ask()
    assert re.search(words, " ".join(str(caught.value).split()))


def test_a_missing_python_control_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only to_control needs it."""
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(InputError, match=r"auv-cosim\[control\]"):
        dead_time(1.0).to_control(omega=[1.0])


def test_roots_and_norm_of_a_system_are_those_of_its_loop() -> None:
    """The functions for loops take a `DelayLTI`, with its delays; what is neither is refused."""
    system = DelaySystem([[0.1]], [[1.0]], C=[[1.0]], D=[[1.0]], delays=[Delay(0.5, feedback=True)])
    loop = close(system, [[-1.0]])
    G = lti(system, gain=[[-1.0]])
    assert spectral_abscissa(G) == pytest.approx(spectral_abscissa(loop), rel=1e-12)
    np.testing.assert_allclose(characteristic_roots(G, 4), characteristic_roots(loop, 4), rtol=1e-9)
    norms = hinf_norm(G), hinf_norm(loop)
    assert norms[0] is not None
    assert norms[1] is not None
    assert norms[0].value == pytest.approx(norms[1].value, rel=1e-9)
    for ask in (spectral_abscissa, characteristic_roots, hinf_norm):
        with pytest.raises(InputError, match="not a closed loop"):
            ask(system)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="without states"):
        spectral_abscissa(dead_time(0.3))
