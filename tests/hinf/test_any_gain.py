"""An analysis ends in a verdict for any finite numbers, and refuses those that are not finite."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from cli.shell import cosim
from shared import sampled, share_of

from cosim.core import InputError
from cosim.hinf import Delay, DelaySystem, analyse, certified_delay
from cosim.models import paper_example

VERDICTS = {"certified", "unstable", "undecided"}
SIZES = (-300, -160, -12, -3, 0, 0, 0, 3, 12, 150, 300)
"""Powers of ten of the entries of systems."""


@pytest.mark.parametrize(
    "size", sampled([1e12, 1e300, 1e-300, 1e3, 1e9, 1e13, 1e50, 1e150, 1e-9], 3)
)
def test_a_gain_of_any_size_has_a_verdict(size: float) -> None:
    """A reason stands beside what is not certified; the paper's loop at 1e12 raised once."""
    found = analyse(paper_example.system(), [[size, -size]])
    assert found.verdict in VERDICTS
    assert found.certified == (found.reason is None)
    if size >= 1e9:
        assert found.verdict == "undecided"
    if size == 1e3:
        assert found.gamma is not None
        assert found.exact_norm is not None
        assert found.certified
        assert found.gamma >= found.exact_norm
    if size < 1:
        assert found.verdict == "certified"


def random_case(seed: int) -> tuple[DelaySystem, Any, Any]:
    """A system of entries of all sizes, a gain and an order."""
    draw = np.random.default_rng(seed)

    def matrix(*shape: int) -> Any:
        spread = shape if draw.random() < 0.3 else ()
        return draw.normal(size=shape) * 10.0 ** draw.choice(SIZES, size=spread)

    n, m = int(draw.integers(1, 4)), int(draw.integers(1, 3))
    parts: dict[str, Any] = {}
    if draw.random() < 0.6:
        parts |= {"C": matrix(n, 1), "D": matrix(1, n)}
    if draw.random() < 0.4:
        parts |= {"E": matrix(n, 1), "H": matrix(1, n)}
    delays = []
    for j in range(int(draw.integers(0, 3))):
        d = 10.0 ** draw.uniform(-12, 4) if draw.random() < 0.5 else draw.uniform(0.01, 1)
        ages: list[dict[str, Any]] = [{}, {"any_age": True}, {"rate": 0.3}, {"sampled": True}]
        fed = j == 0 and bool(draw.random() < 0.4)
        A = np.zeros((n, n)) if fed else matrix(n, n)
        delays.append(Delay(float(d), A, feedback=fed, **ages[int(draw.integers(0, 4))]))
    system = DelaySystem(matrix(n, n), matrix(n, m), delays=delays, **parts)
    K = np.clip(matrix(m, n) * 10.0 ** draw.choice([-9, 0, 6, 12, 150]), -1e308, 1e308)
    return system, K, (0, 1)[int(draw.integers(0, 2))]


def has_a_verdict(seed: int) -> None:
    """No error, and no verdict without its reason."""
    system, K, order = random_case(seed)
    found = analyse(system, K, order=order)
    assert found.verdict in VERDICTS
    assert found.certified == (found.reason is None)
    assert repr(found)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("seed", sampled([28, 137, 4, 79, 132, *range(4)], 2))
def test_random_systems_have_a_verdict(seed: int) -> None:
    """The first five raised an error of numpy once."""
    has_a_verdict(seed)


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("seed", share_of(range(1000, 1200)))
def test_more_random_systems_have_a_verdict(seed: int) -> None:
    """The same of others."""
    has_a_verdict(seed)


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf"), "x", None])
def test_what_is_no_number_is_bad_input(bad: Any) -> None:
    """In a gain and in a system."""
    with pytest.raises(InputError, match="gain"):
        analyse(paper_example.system(), [[bad, 1.0]])
    if isinstance(bad, float):
        with pytest.raises(ValueError, match="finite"):
            DelaySystem([[bad]])


@pytest.mark.slow
def test_the_greatest_delay_of_a_huge_gain_is_found_or_not() -> None:
    """At a delay where it cannot be analysed, the search goes on below."""
    found = certified_delay(paper_example.system(), [[1e12, -1e12]], limit=1.0, precision=0.1)
    assert found.result.certified == (found.delay is not None)
    assert found.delay is None or found.delay < 1.0


@pytest.mark.slow
def test_the_command_answers_undecided(tmp_path: Any) -> None:
    """With exit code 0, as its help says; 2 for a NaN."""
    result = cosim("analyse", "paper", "--gain", "[[1e12, -1e12]]", cwd=tmp_path)
    assert result.code == 0, result.err
    assert "undecided" in result.out
    assert "roots" in result.out
    assert cosim("analyse", "paper", "--gain", "[[nan, 1]]", cwd=tmp_path).code == 2
