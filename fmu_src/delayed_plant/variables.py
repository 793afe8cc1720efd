"""FMI variables of DelayedPlant, for any dimensions of Eq. (7); the default is section 5's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from cosim.models import paper_example
from fmu_src.spec import ComponentSpec, Variable

LETTERS = ("A", "A1", "B", "C", "D", "D1", "D2", "E", "H", "H1")

Matrix = Sequence[Sequence[float]]


def delayed_plant_spec(
    matrices: Mapping[str, Matrix],
    *,
    d: float,
    initial: Sequence[float],
    F: tuple[float, float],
    name: str = "DelayedPlant",
    description: str = "Linear system with delay, disturbance and uncertainty, Eq. (7)",
    stop_time: float = 10.0,
    step_size: float = 0.01,
) -> ComponentSpec:
    """A DelayedPlant of the given matrices (all of `LETTERS`, as lists of rows).

    `F` is amplitude and angular frequency [rad/s] of the uncertainty F(t); start values are
    the given ones, dimensions are fixed.
    """
    shapes = {
        k: [len(matrices[k]), len(matrices[k][0]) if len(matrices[k]) else 0] for k in LETTERS
    }
    n, m = shapes["B"]
    p, q = shapes["D"][0], shapes["C"][1]
    at_start = [sum(a * b for a, b in zip(row, initial, strict=True)) for row in matrices["D"]]
    u = [f"u[{j}]" for j in range(1, m + 1)]
    w = [f"w[{k}]" for k in range(1, q + 1)]
    table = [Variable(name_, "input", f"control {name_}") for name_ in u]
    table += [Variable(name_, "input", f"disturbance {name_}") for name_ in w]
    table += [
        Variable(f"x[{i}]", "output", f"state x[{i}]", start=float(initial[i - 1]))
        for i in range(1, n + 1)
    ]
    for row in range(p):
        table.append(
            Variable(
                f"z[{row + 1}]",
                "output",
                f"performance output z[{row + 1}] = D x + D1 w + D2 u",
                start=float(at_start[row]),
                # every entry of D1 and D2 may be set at run time: all inputs may reach z
                depends_on=tuple(u + w),
            )
        )
    for letter in LETTERS:
        for i, entries in enumerate(matrices[letter], 1):
            for j, value in enumerate(entries, 1):
                text = f"entry ({i},{j}) of {letter} in Eq. (7)"
                table.append(Variable(f"{letter}[{i},{j}]", "parameter", text, None, float(value)))
    table += [
        Variable("delay.d", "parameter", "delay d of Eq. (7)", "s", d, minimum=0.0),
        Variable(
            "F.amplitude",
            "parameter",
            "F(t) = amplitude sin(omega t), times the identity",
            None,
            F[0],
            minimum=-1.0,
            maximum=1.0,
        ),
        Variable("F.omega", "parameter", "angular frequency of F(t)", "rad/s", F[1]),
    ]
    table += [
        Variable(f"initial.x[{i}]", "parameter", f"x[{i}] for all t <= start", None, float(value))
        for i, value in enumerate(initial, 1)
    ]
    table.append(
        Variable(
            "solver.step", "parameter", "largest internal integration step", "s", 0.01, minimum=1e-6
        )
    )
    return ComponentSpec(
        name=name,
        description=description,
        variables=tuple(table),
        behaviour="fmu_src.delayed_plant.behaviour:DelayedPlant",
        sources=(
            "cosim.models.products",
            "cosim.models.delayed_linear",
            "cosim.models.delay_line",
            "fmu_src.python_shell.delay_plant",
            "fmu_src.delayed_plant.behaviour",
        ),
        readme=Path(__file__).with_name("readme.md"),
        stop_time=stop_time,
        step_size=step_size,
        constants={"shapes": shapes},
    )


SPEC = delayed_plant_spec(
    {letter: getattr(paper_example, letter) for letter in LETTERS},
    d=paper_example.d,
    initial=paper_example.INITIAL_STATE,
    F=(paper_example.F_AMPLITUDE, paper_example.F_OMEGA),
)
