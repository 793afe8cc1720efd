"""What a proof says of recorded links, formatted for a terminal and as JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from cosim.cli.terminal import NONE, plain, table
from cosim.hinf.delay_lti import MeanSquare
from cosim.recordings import OutageVerdict

_MOST_TIMES = 5


def verdict_json(file: Path, design: Path, found: Mapping[str, OutageVerdict]) -> dict[str, Any]:
    """Return the verdicts as plain JSON values."""
    return {
        "file": str(file),
        "design": str(design),
        "links": {name: _json(each) for name, each in found.items()},
    }


def _json(found: OutageVerdict) -> dict[str, Any]:
    chain = found.chain
    return {
        "holds": found.holds,
        "age_s": found.age_s,
        "other_s": found.other_s,
        "statistics": asdict(found.statistics),
        "outages": asdict(found.bound) | {"decays": found.bound.decays},
        "chain": None
        if chain is None
        else {"transitions": chain.transitions.tolist(), "loss": chain.loss.tolist()},
        "mean_square_by_rates": None if found.rates is None else asdict(found.rates),
        "mean_square_of_jumps": None if found.jump is None else asdict(found.jump),
        "remarks": list(found.remarks),
    }


def verdict_line(file: Path, found: Mapping[str, OutageVerdict]) -> str:
    """Say of each link whether it was up for as long as the proof needs."""
    return "; ".join(
        f"{name or file}: the proof {'holds' if each.holds else 'does not hold'}, link up "
        f"{_percent(each.bound.share_had)} of the time, {_percent(each.bound.share_needed)} needed"
        for name, each in found.items()
    )


def verdict_view(file: Path, found: Mapping[str, OutageVerdict]) -> RenderableType:
    """Show a line for each link, and what stands behind it."""
    columns = (
        *("link", ">loss", ">P(loss|loss)", ">longest run", ">needed", ">link up", ">gamma held"),
        *(">V at most", ">mean square: rates", ">jumps", "verdict"),
    )
    rows = (
        (
            plain(name or str(file)),
            _percent(each.statistics.loss),
            _percent(each.statistics.loss_after_loss),
            str(max(each.statistics.runs_of_losses, default=0)),
            _percent(each.bound.share_needed),
            _percent(each.bound.share_had),
            _percent(each.bound.guaranteed_share),
            _power(each.bound.greatest_exponent),
            _radius(each.rates),
            _radius(each.jump),
            Text("holds", style="green") if each.holds else Text("not enough", style="red"),
        )
        for name, each in found.items()
    )
    lines: list[RenderableType] = [table(columns, rows)]
    for name, each in found.items():
        label = name or str(file)
        for begin, end in each.bound.suspensions_s[:_MOST_TIMES]:
            until = "the end" if end is None else f"{end:.6g} s"
            lines.append(plain(f"{label}: gamma suspended from {begin:.6g} s to {until}"))
        more = len(each.bound.suspensions_s) - _MOST_TIMES
        if more > 0:
            lines.append(plain(f"{label}: and {more} times more (--json has all)"))
        lines += [plain(f"{label}: {remark}") for remark in each.remarks]
    sentences = dict.fromkeys(
        sentence
        for each in found.values()
        for test in (each.rates, each.jump)
        if test is not None
        for sentence in test.assumptions
    )
    if sentences:
        lines.append(plain("mean square (stable below 1; * proved) assumes:"))
        lines += [plain(f"  {sentence}") for sentence in sentences]
    return Group(*lines)


def _radius(found: MeanSquare | None) -> str:
    return NONE if found is None else f"{found.radius:.4g}{'*' * found.proved}"


def _percent(share: float | None) -> str:
    return NONE if share is None else f"{100 * share:.3g} %"


def _power(exponent: float) -> str:
    return f"{math.exp(exponent):.3g}" if exponent < 50 else f"e^{exponent:.3g}"
