"""Published examples: the exact answer, the best published bound, ours, and the seconds it took.

Exact answers come from the roots and norms of `tests/hinf/truth_of_loops.py`, which share no code
with the product, or from a closed form; ours are certified, in rational arithmetic. A bound of a
delay may not lie above the exact one, a bound of a norm not below.

Sources:

* Gu, Kharitonov, Chen, Stability of Time-Delay Systems, 2003: the scalar loop (closed form), and
  the loop that needs its delay (exact interval);
* Seuret, Gouaisbaut, Automatica 49, 2013 and Syst. Control Lett. 81, 2015: the ladder of orders
  (Wirtinger, Bessel-Legendre), whose figures stand as "published" at each order;
* Olgac, Sipahi, IEEE Trans. Autom. Control 47, 2002: a loop that gets stable again (exact);
* Michiels, Niculescu, Stability and Stabilization of Time-Delay Systems, 2007: x' = x + u with one
  late gain has a stabilising gain for delays below 1 (closed form);
* Fridman, Shaked, IEEE Trans. Autom. Control 47, 2002: the state feedback, here with the bound
  0.1287 of that literature; no gain has less than 0.1;
* the networked loop A = [0 1; 0 -.1], B = [0; .1], K = -[3.75 11.5]: any age 1.04 (Park, Ko, Jeong,
  Automatica 47, 2011), sampled 1.6 (Fridman, Automatica 46, 2010), constant 1.1672 (exact).

Prints a table and JSON (--json: JSON alone).
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table
from scipy.optimize import brentq

from cosim.hinf import (
    Delay,
    DelaySystem,
    analyse,
    certified_delay,
    check_certificate,
    design,
    greatest_delay,
)
from tests.benchmarks._show import show

sys.path.insert(0, str(Path(__file__).parents[1] / "hinf"))
from truth_of_loops import abscissa, first_loss, loop_of, norm

SCALAR = DelaySystem([[0.0]], delays=[Delay(1.0, [[-1.0]])])
LADDER = DelaySystem([[-2, 0], [0, -0.9]], delays=[Delay(1.0, [[-1, 0], [-1, -1]])])
NEEDS_ITS_DELAY = DelaySystem([[0, 1], [-2, 0.1]], delays=[Delay(1.0, [[0, 0], [1, 0]])])
OLGAC_SIPAHI = DelaySystem(
    [[-1, 13.5, -1], [-3, -1, -2], [-2, -1, -4]],
    delays=[Delay(0.1, [[-5.9, 7.1, -70.3], [2, -1, 5], [2, 0, 6]])],
)
UNSTABLE = DelaySystem([[1.0]], [[1.0]], delays=[Delay(0.5, [[0.0]], feedback=True)])
FEEDBACK = DelaySystem(
    *([[0, 0], [0, 1]], [[0], [1]], [[1], [1]], [[0, 1], [0, 0]], None, [[0], [0.1]]),
    delays=[Delay(0.999, [[-1, -1], [0, -0.9]])],
)
BOUNDED_REAL = DelaySystem(
    [[-2, 0], [0, -0.9]], C=[[-0.5], [1]], D=[[1, 0]], delays=[Delay(0.846, [[-1, 0], [-1, -1]])]
)
NETWORKED, GAIN = ([[0, 1], [0, -0.1]], [[0], [0.1]]), [[-3.75, -11.5]]


class Example(NamedTuple):
    """A published example: `exact` None where nobody knows it; `upper`: ours bounds from above."""

    name: str
    figure: str
    exact: float | None
    published: float | None
    ours: Callable[[], tuple[float | None, Any]]
    upper: bool = False


def _networked(**kind: Any) -> DelaySystem:
    return DelaySystem(*NETWORKED, delays=[Delay(1.0, np.zeros((2, 2)), feedback=True, **kind)])


def _longest(system: DelaySystem, gain: Any = None, **how: Any) -> tuple[float | None, Any]:
    found = certified_delay(system, gain, **how)
    return found.delay, found.result.certificate


def _gain(found: Any) -> tuple[float | None, Any]:
    return found.gamma, found.certificate


def _stabilised() -> tuple[float | None, Any]:
    found = greatest_delay(UNSTABLE, None, order=1, limit=2.0)
    return found.delay, found.result.certificate


def examples() -> Iterator[Example]:
    """Return the rows, exact answers computed."""
    yield Example(
        "x' = -x(t-d)", "greatest delay", math.pi / 2, math.sqrt(2), lambda: _longest(SCALAR)
    )
    exact = first_loss(loop_of(LADDER), 0)
    for order, published in enumerate((4.472, 6.059, 6.1689, 6.1725)):
        yield Example(
            "two states, ladder",
            f"greatest delay, order {order}",
            exact,
            published,
            lambda order=order: _longest(LADDER, order=order),
        )
    loop = loop_of(NEEDS_ITS_DELAY)
    exact = float(brentq(lambda d: abscissa(loop.at(0, d)), 1.6, 1.8))
    yield Example(
        "needs its delay",
        "end of the interval, order 2",
        exact,
        1.7122,
        lambda: _longest(NEEDS_ITS_DELAY, order=2),
    )
    yield Example(
        "Olgac, Sipahi",
        "greatest delay",
        first_loss(loop_of(OLGAC_SIPAHI), 0),
        0.1623,
        lambda: _longest(OLGAC_SIPAHI),
    )
    yield Example("Michiels, Niculescu", "delay with some gain, order 1", 1.0, 1.0, _stabilised)
    exact = norm(loop_of(BOUNDED_REAL))
    yield Example(
        *("Fridman, Shaked, analysis", "gamma", exact, None),
        lambda: _gain(analyse(BOUNDED_REAL)),
        upper=True,
    )
    yield Example(
        *("Fridman, Shaked, feedback", "gamma (floor 0.1)", 0.1, 0.1287),
        lambda: _gain(design(FEEDBACK)),
        upper=True,
    )
    constant = first_loss(loop_of(_networked(), GAIN), 0)
    for kind, published, known, exact_age in (
        ("any age", 1.04, {"any_age": True}, None),
        ("sampled", 1.6, {"sampled": True}, None),
        ("constant", None, {}, constant),
    ):
        yield Example(
            *("networked loop", f"greatest age, {kind}", exact_age, published),
            lambda known=known: _longest(_networked(**known), GAIN),
        )


def main() -> None:
    """Compute, check, print."""
    rows = []
    table = Table(title="Published examples", title_justify="left")
    for column in ("example", "figure"):
        table.add_column(column)
    for column in ("exact", "published", "ours, certified", "of exact", "CPU s"):
        table.add_column(column, justify="right")
    for one in examples():
        began = time.process_time()
        value, certificate = one.ours()
        seconds = time.process_time() - began
        valid = certificate is not None and check_certificate(certificate).valid
        ratio = None if value is None or not one.exact else value / one.exact
        false = ratio is not None and (ratio < 1 if one.upper else ratio > 1)
        if false or not valid:
            sys.exit(f"{one.name}, {one.figure}: {value} against {one.exact}, proved: {valid}")
        figures = (one.exact, one.published, value, ratio, seconds)
        table.add_row(*one[:2], *("–" if x is None else f"{x:.5g}" for x in figures))
        keys = ("exact", "published", "ours", "ratio_to_exact", "cpu_s")
        rows.append(
            {"example": one.name, "figure": one.figure, **dict(zip(keys, figures, strict=True))}
        )
    show(table, {"benchmark": "published", "rows": rows})


if __name__ == "__main__":
    main()
