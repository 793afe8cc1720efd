"""One line for every thing of `cosim.hinf` that a user prints, a table in a notebook, pictures."""

from __future__ import annotations

import builtins
from typing import Any

import control
import matplotlib as mpl
import numpy as np
import pytest

from cosim.core import InputError
from cosim.hinf import (
    Delay,
    DelaySystem,
    analyse,
    as_cvxpy,
    check_certificate,
    design,
    lti,
    system_by_name,
)
from cosim.hinf.delay_lti import close, dead_time
from cosim.models import paper_example

mpl.use("Agg")
SYSTEM = paper_example.system()
FOUND = design(SYSTEM, (0.6,), (0.2,))
L = 2 * lti(control.tf([1], [1, 1])) * dead_time(0.5)
T = L.feedback()


@pytest.mark.parametrize(
    ("thing", "words"),
    [
        (
            SYSTEM,
            "<DelaySystem 'paper': 2 states, 1 control, 1 disturbance, 2 outputs, delay 0.3 s",
        ),
        (SYSTEM.delays[0], "<Delay: 0.3 s, of 2 states>"),
        (
            Delay(0.2, np.eye(2), None, [True, False], any_age=True),
            "0.2 s, any age, feedback of x[1]",
        ),
        (Delay(2.0, np.eye(2), least_age=1.0, rate=0.5), "2 s, rate up to 0.5, at least 1 s"),
        (DelaySystem([[-1.0]]), "<DelaySystem: 1 state, no delay>"),
        (system_by_name("auv").system, "delays 0.5 s, any age; 1.25 s, any age, feedback"),
        (FOUND, "<Result 'paper': K = [["),
        (FOUND, "gamma 5.00001 certified, for every smaller delay too>"),
        (
            FOUND.certificate,
            "<Certificate: stability and H-infinity gain <= 5.00001, delay 1 constant",
        ),
        (check_certificate(FOUND.certificate), "<CertificateCheck: valid; stability and"),
        (analyse(DelaySystem([[1.0]])), "<Result: u = 0, not certified: "),
        (close(SYSTEM, FOUND.K), "<ClosedLoop: 2 states, 1 w, 2 z, delays 0.3 s>"),
        (FOUND.guarantees, "<Guarantees: none>"),
        (
            as_cvxpy(SYSTEM, [0.6], [0.2]),
            "<CvxpyLmi: k1 = [0.6], k2 = [0.2], not solved, <DelaySystem",
        ),
        (T, "<DelayLTI: 1 input, 1 output, 1 state, internal delays 0.5 s>"),
        (T.step_response(1.0), "<TimeResponse: step, 501 samples to 1 s"),
        (L.bode(), "<FrequencyResponse: 1000 points from 0.1 to 100 rad/s, greatest gain 1.99"),
        (L.margins(), "<Margins: gain 1.903 (5.59 dB), phase 70.38 deg, delay 0.7092 s>"),
        (L.nyquist(), "<Nyquist: 0 clockwise encirclements of -1 + 0 open-loop poles"),
    ],
    ids=lambda x: type(x).__name__ if not isinstance(x, str) else x[:20],
)
def test_one_line_says_what_it_is(thing: Any, words: str) -> None:
    """No fractions, no matrices of pages."""
    text = repr(thing)
    assert words in text
    assert "\n" not in text
    assert len(text) < 260


@pytest.mark.parametrize(
    ("thing", "words"),
    [
        (SYSTEM, "<th style='text-align:left'>D1</th>"),
        (SYSTEM.delays[0], "[[-1, 0], [2, 1]]"),
        (FOUND, "norm of the nominal loop (computed)"),
        (FOUND.certificate, "conclusion"),
        (check_certificate(FOUND.certificate), "conclusion"),
        (T, "internal delays 0.5 s"),
        (L.margins(), "deg at 1.73205 rad/s"),
    ],
    ids=lambda x: type(x).__name__ if not isinstance(x, str) else x[:12],
)
def test_a_notebook_shows_a_table(thing: Any, words: str) -> None:
    """With everything escaped: K and names are the user's."""
    html = thing._repr_html_()
    assert words in html
    assert html.startswith("<p>")
    assert html.endswith("</table>")
    assert "<script>" not in DelaySystem([[1.0]], name="<script>")._repr_html_()


def test_every_response_draws_itself() -> None:
    """Into axes of the caller, and with lines that are the numbers."""
    figure, axes = mpl.pyplot.subplots(2, 3)
    step = T.step_response(5.0)
    (line,) = step.plot(axes[0, 0]).lines
    np.testing.assert_array_equal(line.get_ydata(), step.outputs)
    upper, lower = L.bode().plot((axes[0, 1], axes[0, 2]))
    assert "delay 0.7092 s" in upper.get_title()
    assert lower.get_ylim()[0] > -1500  # not the turns of the delay where nothing is left
    curve = L.nyquist().plot(axes[1, 0])
    assert "stable" in curve.get_title()
    assert curve.lines[0].get_xdata()[0] == pytest.approx(2.0, abs=0.05)
    roots = T.roots(6)
    assert sum(len(x.get_xdata()) for x in roots.plot(axes[1, 1]).lines[2:]) == 6
    mpl.pyplot.close(figure)


def test_a_missing_matplotlib_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """And the extra that has it."""
    real = builtins.__import__

    def missing(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.startswith("matplotlib"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    step = T.step_response(1.0)
    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(InputError, match=r"auv-cosim\[plot\]"):
        step.plot()
