"""How old messages may be, formatted for a terminal, as JSON and as a picture."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from cosim import core, hinf
from cosim.cli.terminal import NONE, facts, number
from cosim.core import at_least, at_most

_BLUE, _RED, _GREY = "#0b6e99", "#d1495b", "#666666"
_NAMES = {
    "any": "any age",
    "sampled": "sampled",
    "constant": "constant",
    "exact": "constant, exact",
}


def age_json(
    name: str, found: hinf.MessageAges, modem: hinf.problem.Modem | None, picture: Path | None
) -> dict[str, Any]:
    """Return the answer as plain JSON values."""
    return {
        "system": name,
        "delay": found.delay_index + 1,
        "assumption": found.assumption,
        "least_age_s": found.least_age,
        "gamma": found.gamma,
        "modem": None
        if modem is None
        else asdict(modem)
        | {
            "arithmetic": [
                dict(zip(("what", "seconds", "of"), x, strict=True)) for x in modem.arithmetic()
            ]
        },
        "limits": [asdict(limit) for limit in found.limits],
        "gain_age_s": found.age,
        "K": found.K.tolist(),
        "rows": [
            {
                "age_s": row.age,
                "certified": row.certified,
                "gamma": row.gamma,
                "exact_norm": row.exact_norm,
                "control": row.control,
                "delay_margin_s": row.margin,
                "stable": row.stable,
                "K": None if row.K is None else row.K.tolist(),
                "reason": row.reason,
            }
            for row in found.rows
        ],
        "picture": None if picture is None else str(picture),
    }


def age_line(name: str, found: hinf.MessageAges) -> str:
    """Say how old the messages of a loop may be, by what was assumed of their age."""
    goal = "stable" if found.gamma is None else f"gamma {found.gamma:g}"
    limits: dict[str, str] = {
        one.assumption: _age(one) for one in found.limits if one.assumption != "exact"
    }
    words = {"any": "however their age varies", "sampled": "sampled", "constant": "of constant age"}
    each = [f"{limits[key]} {words[key]}" for key in words if limits.get(key, NONE) != NONE]
    if not each:
        return f"{name}: no age of its messages is certified ({goal})"
    return f"{name}: certified ({goal}) with messages up to {'; '.join(each)}"


def age_view(
    name: str, found: hinf.MessageAges, modem: hinf.problem.Modem | None
) -> RenderableType:
    """Show the arithmetic of the modem, the limits in order, and the table."""
    parts: list[RenderableType] = []
    if modem is not None:
        rows = ((what, f"{seconds:.4g} s", of) for what, seconds, of in modem.arithmetic())
        parts += [Text("From the modem to the age", style="bold"), facts(*rows), Text()]
    parts += [_limits(name, found), Text(), _table(found)]
    refused = [row for row in found.rows if not row.certified]
    parts += [Text(f"{row.age:g} s: {row.reason}", style="dim") for row in refused]
    return Group(*parts)


def _limits(name: str, found: hinf.MessageAges) -> RenderableType:
    goal = "stability" if found.gamma is None else f"gamma = {found.gamma:g}"
    head = Text.assemble(
        (f"How old the messages of {name} may be", "bold"),
        f": {goal}, the gain for {found.age:.4g} s",
    )
    rows = ((_NAMES[one.assumption], _age(one), _meaning(one, found)) for one in found.limits)
    return Group(head, facts(*rows))


def _age(limit: hinf.synthesis.AgeLimit) -> str:
    if limit.age is None:
        return "no limit" if limit.assumption == "exact" else NONE
    if limit.assumption == "exact":
        return f"{limit.age:.4g} s"
    return f"{'≥ ' if limit.limit_reached else ''}{at_least(limit.age, 4)} s"


def _meaning(limit: hinf.synthesis.AgeLimit, found: hinf.MessageAges) -> str:
    least = f" from {found.least_age:.4g} s" if found.least_age else ""
    what = {
        "any": f"certified: however the age varies{least}",
        "sampled": f"certified: it grows at rate one{least} between messages",
        "constant": "certified: it stays the same",
        "exact": "computed: the nominal loop loses stability here, without uncertainty"
        if limit.age is not None
        else "computed: the nominal loop is stable at every constant age",
    }[limit.assumption]
    if limit.assumption != "exact" and limit.age is None:
        return what.replace("certified", "not certified at any age", 1)
    return what


def _table(found: hinf.MessageAges) -> Table:
    assumed = {
        "any": "any age up to this",
        "sampled": "sampled, up to this",
        "constant": "constant",
    }[found.assumption]
    if found.least_age:
        assumed += f", from {found.least_age:.4g} s"
    table = Table(
        title=f"What each age costs ({assumed})",
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        caption="gamma: certified, uncertainty included; norm, control (from w to u), margin: "
        "exact, of the nominal loop with this constant age (sampled: with its mean)",
        caption_justify="left",
    )
    for column in ("age [s]", "gamma", "norm", "control", "|K|", "margin [s]"):
        table.add_column(column, justify="right")
    for row in found.rows:
        size = None if row.K is None else float(np.linalg.norm(row.K, 2))
        style = "bold" if row.age == found.age else None
        table.add_row(
            f"{row.age:.4g}",
            _gamma(row),
            number(row.exact_norm, 4),
            number(row.control, 4),
            number(size, 3),
            NONE if row.K is None else "none" if row.margin is None else f"{row.margin:.4g}",
            style=style,
        )
    return table


def _gamma(row: hinf.synthesis.AgeRow) -> str:
    if row.gamma is not None:
        return at_most(row.gamma, 5)
    return "stable" if row.certified else "not proved"


def draw_ages(name: str, found: hinf.MessageAges, target: Path) -> Path:
    """Draw gamma, norm and control over the age, with the limits as lines.

    Raises
    ------
    InputError : matplotlib is not installed, or the file cannot be written.
    """
    plt = core.pyplot()
    with plt.rc_context({"font.size": 9, "axes.grid": True, "grid.alpha": 0.3}):
        figure, (above, below) = plt.subplots(
            2, 1, figsize=(8.4, 6.2), layout="constrained", sharex=True, height_ratios=(1.7, 1)
        )
        for axis, key, label, colour, mark in (
            (above, "gamma", "gamma, certified", _BLUE, "o"),
            (above, "exact_norm", "exact norm", _RED, "."),
            (below, "control", None, _GREY, "."),
        ):
            points = [(row.age, getattr(row, key)) for row in found.rows]
            drawn = [point for point in points if point[1] is not None]
            if drawn:
                axis.plot(*zip(*drawn, strict=True), lw=1.4, color=colour, marker=mark, label=label)
        if any(row.gamma for row in found.rows):
            above.set_yscale("log")
        above.legend(loc="upper left", frameon=False)
        above.set_title(f"{name}: what the age of the messages costs", loc="left")
        above.set_title(f"lines: limits of the gain for {found.age:.4g} s", loc="right", fontsize=8)
        below.set(xlabel="greatest age of a message [s]", ylabel="control per disturbance")
        below.set_ylim(bottom=0.0)
        for limit in found.limits:
            if limit.age is not None and not limit.limit_reached:
                exact = limit.assumption == "exact"
                for axis in (above, below):
                    axis.axvline(limit.age, color=_GREY, lw=0.9, ls="-" if exact else ":")
                below.text(
                    *(limit.age, 0.04, f"{_NAMES[limit.assumption]} {limit.age:.4g} s"),
                    transform=below.get_xaxis_transform(),
                    rotation=90, fontsize=7, va="bottom", color=_GREY,
                    ha="left" if exact else "right",
                )  # fmt: skip
        try:
            return core.save_picture(figure, target)
        finally:
            plt.close(figure)
