"""Fits of recorded links, formatted for a terminal and as JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from cosim.cli.terminal import NONE, plain
from cosim.recordings import DelayModel, LinkFit, LossModel, Parameter, RangeDependence


def fit_json(file: Path, found: Mapping[str, LinkFit], out: Path | None) -> dict[str, Any]:
    """Return the fits as plain JSON values; what is unknown or infinite is null."""
    return {
        "file": str(file),
        "links": {name: _fit(name, each) for name, each in found.items()},
        "out": None if out is None else str(out),
    }


def _fit(name: str, found: LinkFit) -> dict[str, Any]:
    return {
        "fitted_messages": found.fitted,
        "tested_messages": found.tested,
        "fits": not found.refusals,
        "refusals": found.refusals,
        "gaps": found.gaps,
        "loss": found.loss.name,
        "delay": None if found.delay is None else found.delay.name,
        "losses": [_loss(each) for each in found.losses],
        "delays": [_plain(asdict(each) | {"refused_by": each.refused_by}) for each in found.delays],
        "dependence": [_plain(asdict(each)) for each in found.ranges],
        "link": found.table(),
        "toml": found.toml(name),
    }


def _loss(model: LossModel) -> dict[str, Any]:
    return {
        "name": model.name,
        "states": model.chain.loss.size,
        "transitions": model.chain.transitions.tolist(),
        "transitions_error": _plain(model.transitions_error.tolist()),
        "loss": model.chain.loss.tolist(),
        "loss_error": _plain(model.loss_error.tolist()),
        "parameters": model.parameters,
        "intervals": {
            each.name: None if each.low is None else [each.low, each.high]
            for each in model.probabilities
        },
        "unidentified": model.unidentified,
        "log_likelihood": _plain(model.log_likelihood),
        "tested_log_likelihood": _plain(model.tested),
        "bic": _plain(model.bic),
        "p_values": model.p_values,
        "refused_by": model.refused_by,
    }


def _plain(value: Any) -> Any:
    """Replace numbers that JSON does not have."""
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_plain(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def fit_line(found: Mapping[str, LinkFit]) -> str:
    """Say of each link which models fit it, or that none does."""
    return "; ".join(_in_short(name, each) for name, each in found.items())


def _in_short(name: str, found: LinkFit) -> str:
    if found.refusals:
        return f"{name}: no model fits what was recorded"
    delays = "" if found.delay is None else f" and {found.delay.name} delays"
    return f"{name}: {found.loss.name} losses{delays} fit what was recorded"


def fit_view(found: Mapping[str, LinkFit], out: Path | None) -> RenderableType:
    """Show the models link by link, what refuses them, and the TOML of the chosen ones."""
    parts: list[RenderableType] = []
    for name, each in found.items():
        head = f"fitted to {each.fitted} messages, tested on the {each.tested} after them"
        parts += [Text.assemble((name, "bold"), f": {head}"), _losses(each)]
        parts += [plain(f"{model.name}: {_parameters(model)}") for model in each.losses]
        if each.delays:
            parts.append(_delays(each))
        parts += [plain(_dependence(line)) for line in each.ranges]
        verdict = (each.refusals or ["nothing refuses this link:"]) + each.gaps
        parts += [Text(), *(Text(line, style="bold") for line in verdict)]
        parts.append(plain_lines(each.toml(name)))
    if any(each.refusals for each in found.values()):
        parts.append(Text("a link with recording = FILE replays it, as it was or in blocks"))
    if out is not None:
        parts.append(plain(f"written: {out}"))
    return Group(*parts)


def plain_lines(text: str) -> Text:
    """Return lines of text without markup and control characters."""
    return Text("\n").join(plain(line) for line in text.splitlines())


def _losses(found: LinkFit) -> Table:
    caption = "log-likelihood per message; p: of a difference as large, if the model is right"
    table = _table(f"Losses ({caption})")
    for column in ("model", "fitted", "tested", "BIC", "least p", "refused by"):
        table.add_column(column, justify="left" if column in ("model", "refused by") else "right")
    for model in found.losses:
        table.add_row(
            model.name,
            f"{model.log_likelihood:.4f}",
            f"{model.tested:.4f}",
            f"{model.bic:.1f}",
            f"{min(model.p_values.values()):.2g}",
            _refused(model),
            style="bold" if model is found.loss else None,
        )
    return table


def _refused(model: LossModel | DelayModel) -> str:
    """Return the statistic that refuses a model the most clearly, and how many more do."""
    first, *more = *model.refused_by, NONE
    return f"{first} and {len(more) - 1} more" if len(more) > 1 else first


def _parameters(model: LossModel) -> str:
    if len(model.unidentified) == len(model.probabilities):
        return "the data do not tell its parameters: another model explains them as well"
    words = {each.name: _interval(each) for each in model.probabilities}
    if "p_enter" in words:
        lost = ", ".join(words[name] for name in ("loss_good", "loss_bad"))
        return f"enter {words['p_enter']}, exit {words['p_exit']}; loss {lost}"
    lost = ", ".join(each for name, each in words.items() if name.startswith("loss"))
    stays = ", ".join(each for name, each in words.items() if name.startswith("stay"))
    return f"loss {lost}; stays {stays}" if stays else f"loss {lost}"


def _interval(one: Parameter) -> str:
    """Return a value and its interval, or that the data do not tell it."""
    if not one.identified:
        return "not told by the data"
    if one.low is None or one.high is None:
        return f"{one.value:.4g}"
    return f"{one.value:.4g} [{one.low:.3g}, {one.high:.3g}]"


def _delays(found: LinkFit) -> Table:
    table = _table("Delays (KS: greatest difference of the distributions on the tested part)")
    for column in ("model", "seconds", "log-likelihood", "KS", "least p", "refused by"):
        table.add_column(column, justify="left" if column in ("model", "refused by") else "right")
    for model in found.delays:
        table.add_row(
            model.name,
            _seconds(model),
            f"{model.log_likelihood:.4f}",
            f"{model.distance:.4f}",
            f"{min(model.p_values.values()):.2g}",
            _refused(model),
            style="bold" if model is found.delay else None,
        )
    return table


def _seconds(model: DelayModel) -> str:
    values = {"width": model.width, "mean": model.mean, "sigma": model.sigma}
    more = "".join(f", {key} {value:.4g}" for key, value in values.items() if value)
    return f"{model.delay:.4g}{more}"


def _dependence(line: RangeDependence) -> str:
    unit = " m" if line.of == "range" else ""
    low, high = (
        100 / (1 + math.exp(-line.intercept - line.slope * at))
        for at in (line.least, line.greatest)
    )
    words = (
        f"loss over {line.of}: {low:.3g} % at {line.least:.4g}{unit}, {high:.3g} % at "
        f"{line.greatest:.4g}{unit} (logistic; p = {line.p_value:.2g} that it does not)"
    )
    if line.p_value > 0.05:
        words = f"loss over {line.of}: no dependence that is more than chance"
    if line.speed is not None:
        words += f"; delay = {line.offset_s:.4g} s + range / {line.speed:.4g} m/s"
    return words


def _table(title: str) -> Table:
    return Table(title=title, title_justify="left", title_style="", box=box.SIMPLE_HEAD)
