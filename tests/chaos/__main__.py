"""Trouble at random, through every door; the seed says which.

    python -m tests.chaos [--seed N] [--minutes M] [--jobs J] [--trouble NAME ...]
    python -m tests.chaos --seed N --trial K     # one trial again, and what it printed

Every second trial is Ctrl-C or SIGTERM at a random instant. After each trial the exit code and the
message are among those that the pages name, no traceback is printed, whatever trace there is
passes `verify` or is recovered, and no process and no temporary folder is left.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.table import Table

if __package__ == "tests.chaos":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from chaos.doors import make_stock
from chaos.trials import INTERRUPTIONS, Found, Trial, attempt, trial_of
from chaos.troubles import TROUBLES


class Until(NamedTuple):
    """When to end: after so many minutes, and not before so many interruptions."""

    minutes: float
    interruptions: int


def main() -> int:
    """Print the table; 0 if every trial ended as it must."""
    parser = argparse.ArgumentParser(prog="python -m tests.chaos")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--interruptions", type=int, default=30, help="at least so many")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--trial", type=int, help="this one alone")
    parser.add_argument("--trouble", nargs="*", choices=TROUBLES, default=())
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="chaos-stock-") as folder:
        stock = Path(folder)
        run_s = make_stock(stock)
        troubles = tuple(asked.trouble)
        if asked.trial is not None:
            trial = trial_of(asked.seed, asked.trial, troubles)
            found = attempt(trial, stock, run_s)
            print(f"{trial.door}: {found.words}\n{found.ended.printed}\n{found.ended}")
            print("\n".join(found.departures) or "as it must be")
            return int(bool(found.departures))
        print(f"seed {asked.seed}, {asked.minutes:g} minutes", flush=True)
        until = Until(asked.minutes, asked.interruptions)
        all_found = [*_attempts(asked.seed, until, asked.jobs, troubles, stock, run_s)]
    _show(all_found)
    return int(any(found.departures for found in all_found))


def _attempts(
    seed: int, until: Until, jobs: int, troubles: tuple[str, ...], stock: Path, run_s: float
) -> Iterator[Found]:
    """Try one after the other, `jobs` at once."""
    end, interruptions = time.monotonic() + until.minutes * 60.0, 0
    with ThreadPoolExecutor(jobs) as pool:
        for first in count(0, jobs):
            trials = [trial_of(seed, number, troubles) for number in range(first, first + jobs)]
            for found in pool.map(lambda trial: attempt(trial, stock, run_s), trials):
                if found.departures:
                    _complain(found, troubles)
                yield found
                interruptions += found.trial.trouble in INTERRUPTIONS
            enough = troubles or interruptions >= until.interruptions
            if time.monotonic() > end and enough:
                return


def _complain(found: Found, troubles: tuple[str, ...]) -> None:
    trial: Trial = found.trial
    print(
        f"\n{trial.number}: {trial.door}: {found.words}: exit code {found.ended.code}",
        *found.departures,
        sep="\n  ",
    )
    print("  | " + found.ended.printed[-800:].replace("\n", "\n  | "))
    only = f" --trouble {' '.join(troubles)}" if troubles else ""
    print(f"  again: python -m tests.chaos --seed {trial.seed} --trial {trial.number}{only}")
    sys.stdout.flush()


def _show(all_found: list[Found]) -> None:
    """One line per trouble: how often, through how many doors, how it ended, what departed."""
    table = Table(title="Trouble at random", title_justify="left", box=None)
    for name in ("trouble", "trials", "doors", "exit codes", "longest", "departures"):
        table.add_column(name)
    for trouble in TROUBLES:
        of = [found for found in all_found if found.trial.trouble == trouble]
        if not of:
            continue
        codes = Counter(str(found.ended.code) for found in of)
        table.add_row(
            trouble.replace("_", " "),
            str(len(of)),
            str(len({found.trial.door for found in of})),
            ", ".join(f"{code} ({times})" for code, times in sorted(codes.items())),
            f"{max(found.ended.seconds for found in of):.1f} s",
            str(sum(bool(found.departures) for found in of)),
        )
    Console(width=None if sys.stdout.isatty() else 160).print(table)
    wrong = sum(bool(found.departures) for found in all_found)
    print(f"{len(all_found)} trials, {wrong} not as they must be")


if __name__ == "__main__":
    sys.exit(main())
