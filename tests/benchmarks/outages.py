"""What a proof across outages guarantees on recorded links: a table, link by link, each flown.

`python -m tests.benchmarks.outages` judges recordings drawn from chains with the statistics of
public links; `python -m tests.benchmarks.outages FOLDER` every CSV or MCAP file of a folder, in the
form that `cosim link show` reads. The loop is one axis of a vehicle damped on board (0.05 1/s),
with a gain and an age for the median interval T of each link: K = -(0.1, 0.3 d)/d^2, d = 2.4 T,
other = 0.3 T.

Each link is then flown exactly over its recording, from two starts, zero input by the age d:
"flown" is the largest |x|_P^2 over its bound, V(0) e^g, over all later instants. Above 1 the
guarantee would be false, and the exit code 1. `--json` prints {"outages": {LINK: {...}}}.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg
from rich.table import Table

from cosim import hinf
from cosim.models import Delay, DelaySystem
from cosim.network import Recording
from cosim.recordings import HiddenChain, outage_verdict, read_recordings
from tests.benchmarks._show import show
from tests.truth.touch import in_touch

DAMPING, AGE, OTHER, COUNT = 0.05, 2.4, 0.3, 1800
CHAINS = {
    # fitted (`fit_chain`, two states) to links of the Werbellin trial, ASUNA database, 2016, as in
    # the repository of Morozs et al., WUWNet 2024 (MIT): t3:3->6, t1:1->5, t5:3->1, t2:5->4
    "lake, good": (0.0085, 0.4206, 0.0088, 1.0),
    "lake, average": (0.2344, 0.4747, 0.0, 1.0),
    "lake, in runs": (0.0264, 0.0903, 0.0, 1.0),
    "lake, poor": (0.1838, 0.0709, 0.1035, 1.0),
    # pings each 2 s at sea: P(loss | loss) .87 and .90, P(loss | ok) .09 and .17
    "buoy 1": (0.09, 0.13, 0.0, 1.0),
    "buoy 2": (0.17, 0.10, 0.0, 1.0),
}
"""Name -> p_enter, p_exit, loss in the good state and in the bad one."""


def synthetic() -> Iterator[tuple[str, Recording]]:
    """Recordings drawn from the chains, the same ones always."""
    for name, (enter, leave, good, bad) in CHAINS.items():
        moves = np.array([[1 - enter, enter], [leave, 1 - leave]])
        lost = HiddenChain(moves, np.array([good, bad])).simulate(COUNT, 1, name)[:, 0]
        sent = np.arange(COUNT) * 2 * 10**9
        yield name, Recording(sent, lost, np.full(COUNT, 3 * 10**8))


def in_folder(folder: Path) -> Iterator[tuple[str, Recording]]:
    """Every recording of the files of a folder."""
    for file in sorted(folder.iterdir()):
        if file.suffix in {".csv", ".mcap"}:
            for name, one in read_recordings(file).items():
                yield f"{file.stem} {name}".strip(), one


@cache
def proved(interval: float) -> hinf.Result:
    """The loop for messages that are so far apart [s]."""
    d = float(f"{AGE * interval:.4g}")
    system = DelaySystem(
        A=[[0.0, 1.0], [0.0, -DAMPING]],
        B=[[0.0], [1.0]],
        delays=[Delay(d, np.zeros((2, 2)), feedback=True, any_age=True)],
    )
    gain = [[-0.1 / d**2, -0.3 / d]]
    return hinf.synthesis.with_outages(hinf.analyse(system, gain, order=0), alpha=0.1 / d)


def flight_over_bound(recording: Recording, found: hinf.Result, other: float) -> float:
    """The largest |x|_P^2 over its bound on an exact flight; of V at the start no more is used."""
    outages = found.guarantees.outages
    assert outages is not None
    assert found.K is not None
    system, d = found.system, found.system.delays[0].d
    times, touch = in_touch(recording, d, other)
    came = recording.arrived
    sent = recording.sent_ns[came]
    at = sent if recording.delay_ns is None else sent + recording.delay_ns[came]
    order = np.argsort(at, kind="stable")
    at, newest = at[order] / 1e9 + other, np.maximum.accumulate(sent[order]) / 1e9
    P, S = (
        np.array([[float(x.p) / float(x.q) for x in row] for row in matrix.tolist()])
        for matrix in (outages.unknowns["P"], outages.unknowns["S[0]"])
    )
    # measured at the sendings, used `other` later, until the next one is used or d is over
    instants = np.unique(np.concatenate([recording.sent_ns / 1e9, times, at, newest + d]))
    instants = instants[(instants >= 0) & (instants <= times[-1])]
    rise = np.where(touch, -2 * float(outages.alpha), 2 * float(outages.beta)) * np.diff(times)
    exponent = np.interp(instants, times, np.concatenate([[0.0], np.cumsum(rise)]))
    whole, worst = np.zeros((3, 3)), 0.0
    whole[:2] = np.hstack([system.A, system.B])
    for start in ([1.0, 0.0], [0.0, 1.0]):
        x, seen = np.array(start), {}
        bound = x @ (P + d * S) @ x
        for k, (t, g) in enumerate(zip(instants.tolist(), exponent.tolist(), strict=True)):
            seen[t] = x
            if k:
                worst = max(worst, float(x @ P @ x / (bound * np.exp(g))))
            if k + 1 == instants.size:
                break
            j = int(np.searchsorted(at, t + 1e-12, side="right")) - 1
            there = j >= 0 and instants[k + 1] - newest[j] <= d + 1e-9
            u = float((found.K @ _at(seen, newest[j]))[0]) if there else 0.0
            x = scipy.linalg.expm(whole * (instants[k + 1] - t))[:2] @ np.array([*x, u])
    return worst


def _at(seen: dict[float, Any], t: float) -> Any:
    return seen[t] if t in seen else seen[min(seen, key=lambda own: abs(own - t))]


def row(recording: Recording) -> dict[str, Any]:
    """What one link is like, what is guaranteed on it, and its flight."""
    interval = float(f"{float(np.median(np.diff(recording.sent_ns))) / 1e9:.3g}")
    found, other = proved(interval), OTHER * interval
    verdict = outage_verdict(recording, found, other)
    own, bound = verdict.statistics, verdict.bound
    return {
        "messages": own.messages,
        "loss": own.loss,
        "loss_after_loss": own.loss_after_loss,
        "longest_run": max(own.runs_of_losses, default=0),
        "greatest_age_s": own.greatest_age_s,
        "age_designed_s": verdict.age_s,
        "share_needed": bound.share_needed,
        "share_had": bound.share_had,
        "guaranteed_share": bound.guaranteed_share,
        "growth_exponent": bound.greatest_exponent,
        "suspensions": len(bound.suspensions_s),
        "holds": verdict.holds,
        "mean_square_by_rates": None if verdict.rates is None else verdict.rates.radius,
        "mean_square_of_jumps": None if verdict.jump is None else verdict.jump.radius,
        "flown": flight_over_bound(recording, found, other),
    }


def main() -> None:
    """Judge and fly every recording."""
    folders = [Path(word) for word in sys.argv[1:] if not word.startswith("-")]
    links = in_folder(folders[0]) if folders else synthetic()
    found = {name: row(one) for name, one in links if len(one) > 1}
    table = Table(box=None, title="one axis, K = -(0.1, 0.3 d)/d^2, d = 2.4 T, other = 0.3 T")
    for column in (
        *("link", "loss", "P(loss|loss)", "longest", "oldest", "needed", "link up", "gamma held"),
        *("e^g", "m.s. rates", "jumps", "holds", "flown"),
    ):
        table.add_column(column, justify="left" if column == "link" else "right")
    for name, one in found.items():
        table.add_row(name, *map(_text, (one[key] for key in _COLUMNS)))
    show(table, {"outages": found})
    if any(one["flown"] > 1 for one in found.values()):
        raise SystemExit(1)


_COLUMNS = (
    *("loss", "loss_after_loss", "longest_run", "greatest_age_s", "share_needed", "share_had"),
    *("guaranteed_share", "growth_exponent", "mean_square_by_rates", "mean_square_of_jumps"),
    *("holds", "flown"),
)


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "-" if value is None else f"{value:.3g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
