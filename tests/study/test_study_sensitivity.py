"""Sensitivity indices against the closed form of Ishigami and Homma (1990)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from scipy.stats import sobol_indices
from study.deadly import study

from cosim.core import InputError
from cosim.study import Points, sensitivity

A, B = 7.0, 0.1
NAMES = ("decay", "x0", "u")


def of(samples: int, **more: Any) -> tuple[Any, dict[str, Any]]:
    """The table of a study whose metric is sin a + A sin^2 b + B c^4 sin a."""
    axes = [
        {
            "kind": "saltelli",
            "name": name,
            "path": f"components.tiny.parameters.{name}",
            "uniform": [-np.pi, np.pi],
        }
        for name in NAMES
    ]
    given = {"vary": axes, "samples": samples, "metrics": {"y": "final.tiny.x"}, **more}
    made = study([], **given)
    points = Points(made)
    a, b, c = np.array([points[run] for run in range(points.count)]).T
    y = np.sin(a) + A * np.sin(b) ** 2 + B * c**4 * np.sin(a)
    return pa.table({"run": range(points.count), "y": y}), {"study": made.model_dump(mode="json")}


@pytest.mark.slow
def test_indices_are_those_of_ishigami() -> None:
    """Each interval contains its index; so does the estimate, within two hundredths."""
    table, manifest = of(4096)
    found = sensitivity(table, manifest, "y", confidence=0.99)
    third = 8.0 * B**2 * np.pi**8 / 225.0
    own = (0.5 * (1.0 + B * np.pi**4 / 5.0) ** 2, A**2 / 8.0, 0.0)
    whole = sum(own) + third
    expected = [
        (found.first, [x / whole for x in own]),
        (found.total, [(own[0] + third) / whole, own[1] / whole, third / whole]),
    ]
    for indices, truth in expected:
        for name, value in zip(NAMES, truth, strict=True):
            assert indices[name].value == pytest.approx(value, abs=0.02)
            assert indices[name].low - 1e-3 <= value <= indices[name].high + 1e-3


def test_a_study_says_the_same_whenever_it_is_asked() -> None:
    """Its intervals are drawn by one seed; the indices are those of SciPy's estimators."""
    table, manifest = of(64)
    found = sensitivity(table, manifest, "y")
    assert sensitivity(table, manifest, "y") == found
    blocks = np.array(table["y"]).reshape(64, 5)
    given: Any = {
        "f_A": blocks[:, :1].T,
        "f_B": blocks[:, -1:].T,
        "f_AB": blocks[:, None, 1:-1].transpose(2, 1, 0),
    }
    theirs = sobol_indices(func=given, n=64, rng=np.random.default_rng(0))
    for mine, other in ((found.first, theirs.first_order), (found.total, theirs.total_order)):
        assert [mine[name].value for name in NAMES] == pytest.approx(np.ravel(other), abs=1e-12)


def test_what_gives_no_indices_is_named() -> None:
    table, manifest = of(4)
    with pytest.raises(InputError, match="metric of every run"):
        sensitivity(table.slice(0, 7), manifest, "y")
    with pytest.raises(InputError, match="metric"):
        sensitivity(table, manifest, "z")
    with pytest.raises(InputError, match="independent axes of one kind"):
        of(4, correlations=[{"axes": ["u", "x0"], "value": 0.5}])
