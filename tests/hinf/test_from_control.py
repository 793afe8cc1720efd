"""python-control's models in, frequency responses out; NumPy all the way."""

from __future__ import annotations

import sys
from typing import Any

import control
import numpy as np
import pytest
import scipy.signal

from cosim.core import InputError
from cosim.hinf import Delay, DelaySystem, analyse, design, hinf_norm
from cosim.hinf.delay_lti import close, frequency_response, to_control
from cosim.models import paper_example

A, B = [[0.0, 1.0], [-1.0, -0.4]], [[0.0, 0.0], [1.0, 2.0]]
C, D = [[1.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]]


def _plant() -> Any:
    return control.ss(A, B, C, D)


def test_the_last_inputs_are_the_controls() -> None:
    """As in control.hinfsyn: first w, then u; what comes out are NumPy arrays."""
    delay = Delay(0.2, np.zeros((2, 2)), feedback=True)
    system = DelaySystem.from_state_space(_plant(), ncon=1, delays=[delay], name="servo")
    np.testing.assert_array_equal(system.C, [[0.0], [1.0]])
    np.testing.assert_array_equal(system.B, [[0.0], [2.0]])
    np.testing.assert_array_equal(system.D, C)
    np.testing.assert_array_equal(system.D1, [[0.0], [0.0]])
    np.testing.assert_array_equal(system.D2, [[0.0], [1.0]])
    assert (system.name, system.feedback_delay) == ("servo", 0.2)


def test_scipy_models_are_accepted() -> None:
    """What counts is A, B, C, D in continuous time."""
    ours = DelaySystem.from_state_space(scipy.signal.StateSpace(A, B, C, D), ncon=1)
    theirs = DelaySystem.from_state_space(_plant(), ncon=1)
    for name in ("A", "B", "C", "D", "D1", "D2"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))


def test_without_a_delay_the_design_is_as_good_as_full_information_can_be() -> None:
    """control.hinfsyn is not asked (it measures outputs): the norm of our loop is control's."""
    system = DelaySystem.from_state_space(_plant(), ncon=1)
    found = design(system)
    loop = control.ss(
        system.A + system.B @ found.K, system.C, system.D + system.D2 @ found.K, system.D1
    )
    peak = control.linfnorm(loop)[0] if _has_slycot() else _peak(loop)
    assert found.gamma is not None
    assert found.exact_norm == pytest.approx(peak, rel=1e-4)
    assert peak <= found.gamma <= 1.001 * peak


def _has_slycot() -> bool:
    try:
        import slycot  # noqa: F401, PLC0415
    except ImportError:
        return False
    return True


def _peak(loop: Any) -> float:
    omega = np.concatenate([[0.0], np.logspace(-3, 3, 20001)])
    response = loop(1j * omega)
    return max(np.linalg.norm(response[:, :, k], 2) for k in range(len(omega)))


def test_to_control_gives_the_frequency_response() -> None:
    """The FRD's largest gain is the norm that the level set finds, at its frequency."""
    system = paper_example.system()
    found = design(system, (0.6,), (0.2,), gain=[list(paper_example.PRINTED_K)])
    loop = close(system, found.K)
    assert found.norm_frequency is not None
    omega = np.array([found.norm_frequency, 1.0, 3.0])
    data = to_control(loop, omega)
    assert isinstance(data, control.FRD)
    assert data.ninputs == 1
    assert data.noutputs == 2
    response = frequency_response(loop, omega)
    assert np.linalg.norm(response[:, :, 0], 2) == pytest.approx(hinf_norm(loop).value, rel=1e-9)
    np.testing.assert_allclose(data(3j), response[:, :, 2])
    s = 3j  # by hand: D(s) (s I - A - A1 e^{-0.3 s})^-1 C + D1
    K = np.array([paper_example.PRINTED_K])
    inner = s * np.eye(2) - system.A - system.B @ K - system.delays[0].A * np.exp(-0.3 * s)
    by_hand = (system.D + system.D2 @ K) @ np.linalg.solve(inner, system.C) + system.D1
    np.testing.assert_allclose(response[:, :, 2], by_hand, rtol=1e-12)


@pytest.mark.parametrize(
    ("plant", "ncon", "words"),
    [
        (control.ss(A, B, C, D, 0.1), 1, r"continuous.*dt = 0.1"),
        (control.ss(A, B, C, D, dt=True), 1, "continuous"),
        (control.tf([1], [1, 1]), 1, r"TransferFunction.*control\.ss"),
        (control.ss(A, B, C, D), 3, "0 to 2"),
        (control.ss(A, B, C, D), -1, "0 to 2"),
        (control.ss(A, B, C, D), True, "0 to 2"),
        ("plant.mat", 1, "state-space"),
        (None, 1, "state-space"),
    ],
    ids=lambda x: type(x).__name__ if not isinstance(x, str | int) else str(x)[:12],
)
def test_anything_but_a_continuous_plant_is_refused(plant: Any, ncon: int, words: str) -> None:
    """A discrete model, a transfer function, too many controls, anything else."""
    with pytest.raises(ValueError, match=words):
        DelaySystem.from_state_space(plant, ncon=ncon)


def test_a_plant_in_place_of_a_system_says_how_to_make_one() -> None:
    """design and analyse take systems with delays; the way there is in the message."""
    for ask in (design, analyse):
        with pytest.raises(InputError, match="from_state_space"):
            ask(_plant())
        with pytest.raises(InputError, match="DelaySystem"):
            ask([[1.0]])  # type: ignore[arg-type]


def test_without_python_control_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """The message says what to install."""
    monkeypatch.setitem(sys.modules, "control", None)
    loop = close(paper_example.system(), [list(paper_example.PRINTED_K)])
    with pytest.raises(InputError, match=r"auv-cosim\[control\]"):
        to_control(loop, [1.0])


@pytest.mark.parametrize("omega", [[np.nan], ["fast"], [np.inf]])
def test_invalid_frequencies_are_refused(omega: Any) -> None:
    """So is a loop without w and z."""
    loop = close(paper_example.system(), [list(paper_example.PRINTED_K)])
    with pytest.raises(InputError, match="omega"):
        frequency_response(loop, omega)
    with pytest.raises(InputError, match="no gain"):
        frequency_response(close(DelaySystem([[-1.0]]), np.zeros((0, 1))), [1.0])
