"""FMI variables of DelayedPlant, for any system in the form of Eq. (7).

The default is the example of the paper's section 5. A single delay has the matrices A1, H1 and the
parameter `delay.d`, as in the paper; several have A1, H1, `delay.d1`, A2, H2, `delay.d2`, ...
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from cosim.fmu.export import ComponentSpec, Variable, loop_scenario, round_below, solver_step
from cosim.models import Delay, DelaySystem, paper_example, product

from .page import notes

STEPS = 1000
"""Communication steps of the default experiment."""

_SHARE = 0.16  # of the shortest time constant: the error of RK4 is then some 1e-6 of x per unit
_LONGEST, _SHORTEST = 0.1, 1e-9  # [s]


def plant_delays(system: DelaySystem) -> list[Delay]:
    """Return the delays in the plant; one through which only the control acts is the link's."""
    return [d for d in system.delays if not d.feedback or d.A.any() or d.H.any()]


def delay_names(count: int) -> list[str]:
    """Return the names of the delay parameters."""
    return ["delay.d"] if count == 1 else [f"delay.d{i}" for i in range(1, count + 1)]


def delayed_plant_spec(
    system: DelaySystem,
    *,
    name: str = "DelayedPlant",
    plant: str | None = None,
    controller: str = "controller.fmu",
    initial: Sequence[float] = (),
    F: tuple[float, float] = (0.0, 1.0),
    origin: str = "",
) -> ComponentSpec:
    """Specify a plant with the matrices as start values; their dimensions are fixed.

    Parameters
    ----------
    system : the matrices; of a delay with `feedback` only its A and H, if any.
    plant, controller : files or built-in FMUs in the page's example; NAME.fmu by default.
    initial : x(t) for t <= start, length n; zero by default.
    F : amplitude, at most 1 in size, and angular frequency [rad/s] of the uncertainty F(t).
    origin : a sentence for the page on the origin of the numbers.
    """
    n, m = system.B.shape
    q = system.C.shape[1]
    delays = plant_delays(system)
    named = delay_names(len(delays))
    start = np.asarray(initial if len(initial) else np.zeros(n), dtype=np.float64)
    matrices = plant_matrices(system)
    step = default_step(matrices)
    u = [f"u[{j}]" for j in range(1, m + 1)]
    w = [f"w[{k}]" for k in range(1, q + 1)]
    table = [Variable(one, "input", f"control {one}") for one in u]
    table += [Variable(one, "input", f"disturbance {one}") for one in w]
    table += [
        Variable(f"x[{i}]", "output", f"state x[{i}]", start=float(value))
        for i, value in enumerate(start, 1)
    ]
    table += [
        Variable(
            f"z[{i}]",
            "output",
            f"performance output z[{i}] = D x + D1 w + D2 u",
            start=float(value),
            # every entry of D1 and D2 may be set at run time: all inputs may reach z
            depends_on=tuple(u + w),
        )
        for i, value in enumerate(product(system.D.tolist(), start.tolist()), 1)
    ]
    table += [
        Variable(
            f"{letter}[{i},{j}]", "parameter", f"entry ({i},{j}) of {letter} in Eq. (7)", None, x
        )
        for letter, matrix in matrices.items()
        for i, row in enumerate(matrix.tolist(), 1)
        for j, x in enumerate(row, 1)
    ]
    table += [
        Variable(one, "parameter", f"delay {one[6:]} of Eq. (7)", "s", delay.d, minimum=0.0)
        for one, delay in zip(named, delays, strict=True)
    ]
    if "E" in matrices:
        text = "F(t) = amplitude sin(omega t) on its main diagonal"
        table += [
            Variable("F.amplitude", "parameter", text, None, F[0], minimum=-1.0, maximum=1.0),
            Variable("F.omega", "parameter", "angular frequency of F(t)", "rad/s", F[1]),
        ]
    table += [
        Variable(f"initial.x[{i}]", "parameter", f"x[{i}] for all t <= start", None, float(value))
        for i, value in enumerate(start, 1)
    ]
    table.append(solver_step(step))
    return ComponentSpec(
        name=name,
        description="Linear system with delay, disturbance and uncertainty, Eq. (7)",
        variables=tuple(table),
        behaviour="cosim.components.delayed_plant.behaviour:DelayedPlant",
        sources=(
            "cosim.models.products",
            "cosim.models.delayed_linear",
            "cosim.models.delay_line",
            "cosim.fmu.export.python.delay_plant",
            "cosim.components.delayed_plant.behaviour",
        ),
        readme=Path(__file__).with_name("readme.md"),
        stop_time=STEPS * step,
        step_size=step,
        constants={
            "shapes": {letter: list(matrix.shape) for letter, matrix in matrices.items()},
            "delays": named,
        },
        notes=notes(system, delays, named, origin),
        scenario=loop_scenario(
            plant or f"{name}.fmu",
            controller if m else None,
            feedback_delay=system.feedback_delay,
            step=step,
            end=STEPS * step,
        ),
    )


def plant_matrices(system: DelaySystem) -> dict[str, np.ndarray]:
    """Return the matrices of the plant by letter; E, H, H1, ... only if there is uncertainty."""
    delays = plant_delays(system)
    found = {"A": system.A}
    found |= {f"A{i}": delay.A for i, delay in enumerate(delays, 1)}
    found |= {letter: getattr(system, letter) for letter in ("B", "C", "D", "D1", "D2")}
    if system.E.size:
        found |= {"E": system.E, "H": system.H}
        found |= {f"H{i}": delay.H for i, delay in enumerate(delays, 1)}
    return found


def default_step(matrices: Mapping[str, np.ndarray]) -> float:
    """Return the largest of 1, 2, 5 times a power of ten with step (|A| + |A1| + ...) <= 0.16 [s].

    |.| is the Frobenius norm: no solution of x' = A x + A1 x(t-d) + ... moves faster. The example
    of section 5 gets 0.01 s.
    """
    rate = sum(math.hypot(*M.ravel()) for letter, M in matrices.items() if letter[0] == "A")
    longest = min(_LONGEST, max(_SHARE / rate, _SHORTEST)) if rate > 0 else _LONGEST
    return round_below(longest)


SPEC = delayed_plant_spec(
    paper_example.system(),
    plant="DelayedPlant",
    controller="PaperController",
    initial=paper_example.INITIAL_STATE,
    F=(paper_example.F_AMPLITUDE, paper_example.F_OMEGA),
    origin="The start values are the example of the paper's section 5.",
)
