"""The check of a communication step, formatted for a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Group, RenderableType
from rich.table import Column
from rich.text import Text

from cosim.cli.terminal import NONE, number, table

if TYPE_CHECKING:
    from cosim.scenario import StepCheck

_ROWS = 20
_ANSWER = {
    "yes": "the step is small enough",
    "no": "the step is too long",
    "unclear": "it cannot be said whether the step is small enough",
}


def step_check_line(check: StepCheck) -> str:
    """Say whether the step is small enough, and why."""
    return f"{_ANSWER[check.verdict]}: {check.reason}"


def step_check_view(check: StepCheck) -> RenderableType:
    """Show the signals with the largest estimated error."""
    observed = len(check.steps_s) > 2
    steps = ", ".join(f"{step:g} s" for step in check.steps_s)
    head = Text(f"{check.title}\nrun with steps of {steps}")
    suggested = check.suggested_step_s
    if suggested is not None:
        head.append(f"\na step of about {suggested:.2g} s would meet it")
    rows = (
        (
            signal.name,
            number(signal.difference, 3, signal.unit or ""),
            f"{signal.at_s:g} s",
            number(signal.span, 3, signal.unit or ""),
            number(signal.error, 3, signal.unit or ""),
            NONE if signal.relative_error is None else f"{100 * signal.relative_error:.2g} %",
            *[number(signal.observed_order, 3)] * observed,
        )
        for signal in check.signals[:_ROWS]
    )
    columns: tuple[str | Column, ...] = (
        Column("signal", no_wrap=True),
        *(">largest difference", ">at", ">range", ">error at h", ">of range"),
        *[">order"] * observed,
    )
    parts: list[RenderableType] = [head, table(columns, rows)]
    if len(check.signals) > _ROWS:
        parts.append(Text(f"{len(check.signals) - _ROWS} more with smaller errors: --json"))
    how = (
        f"estimated from the order observed, or {check.order} where there is none"
        if observed
        else f"estimated for order {check.order}, which the coupling should have; "
        "--check-order runs at a quarter of the step too and observes it"
    )
    return Group(*parts, Text(how, style="dim"))
