"""The rows that the benchmarks of traces write and read, and how their cases are measured.

The signals are smooth: the digits of their doubles do not compress, which is the harder case.
Each case runs in a process of its own, the variants in turns; the figure is the least of all
turns. Timed is the CPU of all threads.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

RECORDS = {10: 200_000, 20: 100_000, 200: 10_000}
"""Doubles in a record, and how many records a file has."""

TURNS = 3
CHUNK = 256 * 1024
TOPIC = "/bench"
Times = NDArray[np.int64]
Values = NDArray[np.float64]
Figures = dict[str, dict[str, dict[str, float]]]


def smooth(doubles: int, count: int) -> tuple[Times, Values]:
    """Instants [ns] and rows of smooth signals, the same every time."""
    times = np.arange(count, dtype=np.int64) * 1_000_000
    rates = 0.1 * np.arange(1, doubles + 1)
    return times, np.sin(np.outer(times / 1e9, rates) + np.sqrt(np.arange(doubles)))


def names(doubles: int) -> list[str]:
    """The names of the signals."""
    return [f"x[{i}]" for i in range(1, doubles + 1)]


def tag(number: int) -> bytes:
    """The tag that protobuf puts in front of a double: its field << 3 | 1, to the base 128."""
    left, found = number << 3 | 1, bytearray()
    while left > 0x7F:
        found.append(left & 0x7F | 0x80)
        left >>= 7
    return bytes([*found, left])


def measured(
    script: str, variants: Iterable[str], tell: Callable[[str], None] = lambda _: None
) -> Figures:
    """Run `script VARIANT DOUBLES FOLDER`, which prints JSON: {VARIANT: {DOUBLES: figures}}.

    script : a file; what its cases write in the folder is there for the other variants too.
    """
    found: Figures = {variant: {} for variant in variants}
    for doubles, count in RECORDS.items():
        with tempfile.TemporaryDirectory() as folder:
            for turn in range(TURNS):
                for variant, by_doubles in found.items():
                    tell(f"{count} records of {doubles} doubles, turn {turn + 1}: {variant}")
                    done = subprocess.run(  # noqa: S603 - a file of this folder
                        [sys.executable, script, variant, str(doubles), folder],
                        check=True,
                        stdout=subprocess.PIPE,
                    )
                    figures = json.loads(done.stdout)
                    best = by_doubles.setdefault(str(doubles), figures)
                    best |= {key: min(best[key], value) for key, value in figures.items()}
    return found
