"""The link of the schema that a recording fits best, and whether it fits at all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import tomli_w

from cosim.core import InputError
from cosim.network import Recording
from cosim.recordings.delay_fit import DelayModel, delay_models
from cosim.recordings.loss_fit import LossModel, loss_models
from cosim.recordings.range_fit import RangeDependence, range_dependence
from cosim.recordings.statistics import delays_of

LEAST_MESSAGES = 60
MOST_STATES = 5
_FIRST = 2, 3
"""Share of a recording that models are fitted to: the first two thirds."""


@dataclass(frozen=True)
class LinkFit:
    """The models of a link that were fitted to a recording.

        >>> from cosim.network import Recording
        >>> from cosim.recordings import fit_link
        >>> times = range(0, 60 * 10**9, 10**9)
        >>> lost = [k % 10 == 9 for k in range(60)]
        >>> recording = Recording(times, lost, [10**8] * 60)  # each 0.1 s under way
        >>> fit = fit_link(recording, most_states=2)
        >>> fit.loss.name, fit.delay.name, fit.refusals
        ('independent', 'constant', [])
        >>> fit.table()
        {'kind': 'packet', 'sample_time': 1.0, 'delay': 0.1, 'loss': 0.1}

    Attributes
    ----------
    fitted, tested : number of messages in the part for the fit, and in the part for the test.
    losses, delays : every model, in order of complexity; no delays without times of arrival.
    loss, delay : the chosen models: those with the least criterion (BIC) among the models that no
        test rejects, or else among all; `delay` is None without times of arrival.
    ranges : how losses and delays depend on range and size.
    sample_time_s : median time from one sending to the next [s].
    """

    fitted: int
    tested: int
    losses: list[LossModel]
    delays: list[DelayModel]
    loss: LossModel
    delay: DelayModel | None
    ranges: list[RangeDependence]
    sample_time_s: float

    @property
    def refusals(self) -> list[str]:
        """Why no model of the schema fits, in words; nothing where one does."""
        found = []
        if self.loss.refused_by:
            by = ", ".join(self.loss.refused_by)
            found.append(f"no model of the losses fits; {self.loss.name} is refused by: {by}")
        if self.delay is not None and self.delay.refused_by:
            by = ", ".join(self.delay.refused_by)
            found.append(f"no model of the delays fits; {self.delay.name} is refused by: {by}")
        return found

    @property
    def gaps(self) -> list[str]:
        """What the recording leaves open about the chosen link, in words; empty: nothing."""
        names = ", ".join(self.loss.unidentified)
        if not names:
            return []
        return [f"the recording does not tell {names}: others explain it as well; a longer one may"]

    def table(self) -> dict[str, Any]:
        """Return the chosen link as a table [links.NAME] of a scenario."""
        table: dict[str, Any] = {"kind": "packet", "sample_time": self.sample_time_s}
        if self.delay is not None:
            table |= _delay_keys(self.delay)
        return table | {"loss": _loss_value(self.loss)}

    def toml(self, name: str) -> str:
        """Return that table as TOML; comments say where it does not fit."""
        lines = [f"# {line}\n" for line in (*self.refusals, *self.gaps)]
        lines += [
            f"# delay = {each.offset_s:.4g} s + range / {each.speed:.4g} m/s explains "
            f"{100 * (each.explained or 0.0):.3g} % of its variance\n"
            for each in self.ranges
            if each.speed is not None
        ]
        return "".join([*lines, tomli_w.dumps({"links": {name: self.table()}})])


def fit_link(recording: Recording, most_states: int = 3) -> LinkFit:
    """Fit the models of a link to the first two thirds of a recording; test them on the rest.

        >>> from cosim.network import Recording
        >>> from cosim.recordings import fit_link
        >>> times = range(0, 60 * 10**9, 10**9)
        >>> lost = [k % 10 == 9 for k in range(60)]
        >>> recording = Recording(times, lost, [10**8] * 60)  # each 0.1 s under way
        >>> print(fit_link(recording, most_states=2).toml("uplink"))
        [links.uplink]
        kind = "packet"
        sample_time = 1.0
        delay = 0.1
        loss = 0.1
        <BLANKLINE>

    Raises
    ------
    InputError : fewer than `LEAST_MESSAGES` messages, or a number of states out of range.
    """
    if not 1 < most_states <= MOST_STATES:
        raise InputError(
            "number of states out of range",
            where="`states`",
            expected=f"2 to {MOST_STATES}",
            got=str(most_states),
        )
    lost = recording.lost[recording.ended]
    if lost.size < LEAST_MESSAGES:
        raise InputError(
            "too few messages to fit and to test a model",
            where="recording",
            expected=f"at least {LEAST_MESSAGES} that came or were lost",
            got=str(lost.size),
        )
    first = lost.size * _FIRST[0] // _FIRST[1]
    losses = loss_models(lost[:first], lost[first:], most_states)
    loss = min(losses, key=lambda each: (bool(each.refused_by), each.bic))
    arrived = recording.arrived[recording.ended]
    late, split = delays_of(recording), int(np.count_nonzero(arrived[:first]))
    delays = []
    if min(split, late.size - split) > 1:
        delays = delay_models(late[:split], late[split:])
    delay = min(
        delays, key=lambda each: (bool(each.refused_by), -each.log_likelihood), default=None
    )
    return LinkFit(
        fitted=first,
        tested=lost.size - first,
        losses=losses,
        delays=delays,
        loss=loss,
        delay=delay,
        ranges=range_dependence(recording),
        sample_time_s=float(np.median(np.diff(recording.sent_ns))) / 1e9,
    )


def _delay_keys(model: DelayModel) -> dict[str, Any]:
    keys: dict[str, Any] = {"delay": _rounded(model.delay)}
    values = {"width": model.width, "mean": model.mean, "sigma": model.sigma}
    if model.name != "constant":
        jitter = {key: _rounded(value) for key, value in values.items() if value > 0.0}
        keys["jitter"] = {"kind": model.name, **jitter}
    return keys


def _rounded(seconds: float) -> float:
    """Return a time as scenarios take it: whole nanoseconds, and not none of what is some."""
    return max(round(seconds * 1e9), int(seconds > 0.0)) / 1e9


def _loss_value(model: LossModel) -> Any:
    chain = model.chain
    loss, moves = chain.loss.tolist(), chain.transitions.tolist()
    if len(loss) == 1:
        return loss[0]
    if len(loss) == 2:
        keys = {"p_enter": moves[0][1], "p_exit": moves[1][0]}
        return keys | {"loss_good": loss[0], "loss_bad": loss[1]}
    return {"kind": "chain", "transitions": moves, "loss": loss}
