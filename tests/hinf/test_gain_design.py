"""The door for users: k1 and k2 of no concern, documented examples that run."""

from __future__ import annotations

import doctest
import sys

import numpy as np
import pytest

from cosim.core import InputError
from cosim.hinf import Delay, DelaySystem, check_certificate, design, greatest_delay
from cosim.models import paper_example


def test_the_examples_in_the_documentation_run() -> None:
    """What the docstring shows is what comes out."""
    results = doctest.testmod(sys.modules[design.__module__])
    assert results.attempted >= 3
    assert results.failed == 0


def test_without_k1_and_k2_they_are_searched() -> None:
    """Section 5 by its system alone: below 5.001, where 5 is the bound; the file's 5.0132."""
    found = design(paper_example.system())
    assert found.gamma is not None
    assert 5.0 < found.gamma <= 5.001
    assert check_certificate(found.certificate).valid
    assert design(paper_example.system(), search=False).gamma is not None


def test_k1_or_k2_alone_gives_the_other() -> None:
    """k1 = -k2, either way."""
    one = design(paper_example.system(), k2=(0.4,), order=None)
    other = design(paper_example.system(), (-0.4,), order=None)
    assert (one.k1, one.k2) == (other.k1, other.k2) == ((-0.4,), (0.4,))
    assert one.gamma == other.gamma


def test_systems_without_a_positive_delay_need_no_k1_k2() -> None:
    """Whatever stands in place of 1/d, the design is made and the least gamma is the same."""
    parts = {"B": [[1.0]], "C": [[1.0]], "D": [[1.0], [0.0]], "D2": [[0.0], [1.0]]}
    at_zero = design(DelaySystem([[1.0]], **parts, delays=[Delay(0.0, [[0.0]])]))
    without = design(DelaySystem([[1.0]], **parts))
    assert without.gamma is not None
    assert at_zero.gamma == pytest.approx(without.gamma, rel=1e-3)
    # the Riccati equation's: gamma^2 = 1/2 bounds the pair |x|^2 + |u|^2 for x' = x + u + w
    assert without.gamma == pytest.approx(np.sqrt(2.0), rel=0.5)


def test_greatest_delay_needs_no_k1_k2() -> None:
    """The search of section 5 at gamma = 6 goes beyond every printed delay."""
    assert greatest_delay(paper_example.system(), 6.0, limit=3.0).delay == 3.0


def test_k1_k2_that_do_not_fit_are_refused() -> None:
    """One number per delay, k2 not zero, as before."""
    for k1, k2 in (((0.6, 0.6), None), (None, (0.0,)), ((0.6,), (0.2, 0.2))):
        with pytest.raises(InputError, match=r"k[12]"):
            design(paper_example.system(), k1, k2)


def test_the_plain_lmi_has_no_design_constraints() -> None:
    """cvxpy is for gamma alone; without design constraints it is accepted."""
    system = paper_example.system()
    with pytest.raises(InputError, match="cvxpy is without design constraints"):
        design(system, solver="cvxpy", decay=0.5)
    assert design(system, (0.6,), (0.2,), order=0).order == 0
