"""How a log of messages is written: its columns, delimiter, numbers, times, and what means lost.

One declaration gives the table `format` of a scenario's files, the options of the commands that
read a log, and what messages name of it.
"""

from __future__ import annotations

import json
import shlex
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args

from cosim.core import InputError
from cosim.network.checks import MAX_NS
from cosim.network.keys import ChoiceKey, DurationKey, TextKey, check_keys, keys_of

Delimiter = Literal[",", ";", "tab", "space"]
"""What stands between the columns of a log."""
Unit = Literal["s", "ms", "us", "ns"]
"""In which the times of a log are written."""

DELIMITERS: tuple[Delimiter, ...] = get_args(Delimiter)
DIGITS: dict[Unit, int] = {"s": 9, "ms": 6, "us": 3, "ns": 0}
"""Unit of times -> digits of one of it in nanoseconds."""
UNIT_WORDS: dict[Unit, str] = {
    "s": "seconds",
    "ms": "milliseconds",
    "us": "microseconds",
    "ns": "nanoseconds",
}
"""Unit of times -> its name."""

_LONG_S = 60.0
"""A delay beyond which a link under water is asked about [s]: 90 km of sound."""


@dataclass(frozen=True, slots=True)
class LogFormat:
    r"""How a log of messages is written; anything left open is detected in the file, or an error.

        >>> from pathlib import Path
        >>> from cosim.network import LogFormat
        >>> from cosim.recordings import read_recording
        >>> log = "id;tx;rx\n1;0,0;312,5\n2;2000,0;NaN\n"
        >>> written = Path("modem.log").write_text(log)
        >>> recording = read_recording("modem.log", log_format=LogFormat(unit="ms"))
        >>> recording.sent_ns.tolist(), recording.lost.tolist(), recording.delay_ns.tolist()
        ([0, 2000000000], [False, True], [312500000, 312500000])

    Parameters
    ----------
    sent, received, delay, status, sequence : names of columns; the first three are detected by the
        usual names (`sent`, `tx`, `send_time`; `delivered`, `rx`, `arrival`; `delay`) if exactly
        one column has one. `status` says whether a message was lost: 1 or 0, or a text in `lost`;
        without it, the column `lost` says so. A number that is missing in `sequence` is a message
        that was lost and has no row.
    delimiter : ",", ";", "tab" or "space"; None: that of the header.
    decimal : "." or ","; None: either, but a comma only if it is not the delimiter.
    unit : of times that are numbers; None: as the header says (`tx_ms`, `sent [us]`), else seconds.
        Times in ISO 8601 need none.
    lost : texts that mean lost in place of a time, besides an empty cell; case does not matter.
        None: NaN, NaT, lost, -, -1 (where no message can have come then), inf, null.
    clock_offset_ns : by how much the receiver's clock is ahead of the sender's [ns]; subtracted
        from the times of arrival, and from a delay.
    hints : how error messages name a key: for "python", for a "toml" file, or as "options" of a
        command.

    Raises
    ------
    InputError : a key out of its range, or keys that contradict each other.
    """

    sent: Annotated[str | None, TextKey("column of the times of sending")] = None
    received: Annotated[str | None, TextKey("column of the times of arrival")] = None
    delay: Annotated[str | None, TextKey("column of the delays, in place of received")] = None
    status: Annotated[str | None, TextKey("column that says whether a message was lost")] = None
    sequence: Annotated[
        str | None, TextKey("column of sequence numbers; a missing one is a lost message")
    ] = None
    delimiter: Annotated[
        Delimiter | None,
        ChoiceKey("character between two columns; without it, detected", DELIMITERS),
    ] = None
    decimal: Annotated[
        Literal[".", ","] | None,
        ChoiceKey("decimal point or comma; without it, detected", (".", ",")),
    ] = None
    unit: Annotated[
        Unit | None,
        ChoiceKey("unit of times that are numbers; without it, the header's, or s", get_args(Unit)),
    ] = None
    lost: Annotated[
        tuple[str, ...] | None,
        TextKey("text that means lost in place of a time, besides an empty cell", several=True),
    ] = None
    clock_offset_ns: Annotated[
        int, DurationKey("time by which the receiver's clock is ahead", least_ns=-MAX_NS)
    ] = 0
    hints: Literal["python", "toml", "options"] = "python"

    def __post_init__(self) -> None:
        if isinstance(self.lost, str | list):
            texts = (self.lost,) if isinstance(self.lost, str) else tuple(self.lost)
            object.__setattr__(self, "lost", texts)
        check_keys("format.", self)
        contradiction = None
        if self.received is not None and self.delay is not None:
            contradiction = "received", "delay"
        if self.delimiter == self.decimal == ",":
            contradiction = "delimiter", "decimal"
        if contradiction is not None:
            given = {key: getattr(self, key) for key in contradiction}
            raise InputError(
                f"{' and '.join(contradiction)} contradict each other",
                where="the format of a log",
                expected="one of the two",
                got=self.named(**given),
            )

    def named(self, **keys: Any) -> str:
        """Return keys as they are given where this format comes from; times in seconds."""
        declared = keys_of(LogFormat)
        if self.hints == "options":
            return " ".join(
                f"--{key.replace('_', '-')} {shlex.quote(str(each))}"
                for key, value in keys.items()
                for each in (value if isinstance(value, tuple) else (value,))
            )
        if self.hints == "toml":
            entries = (f"{k} = {json.dumps(v, ensure_ascii=False)}" for k, v in keys.items())
            return f"format = {{ {', '.join(entries)} }}"
        given = (
            (key, round(value * 1e9) if declared[key].field.endswith("_ns") else value)
            for key, value in keys.items()
        )
        return f"LogFormat({', '.join(f'{declared[k].field}={v!r}' for k, v in given)})"


def unit_doubt(median_s: float, unit: Unit | None, log_format: LogFormat) -> str | None:
    """Return what is doubtful about a median delay, and what to do; None where nothing is.

    unit : of the delays or times as read; None where they are no numbers.
    """
    if median_s <= _LONG_S:
        return None
    units = [*DIGITS]
    smaller = None if unit in (None, "ns") else units[units.index(unit) + 1]
    asked = "are both times of one clock, and of one time zone?"
    if smaller is not None:
        asked = f"are these {UNIT_WORDS[smaller]}? give {log_format.named(unit=smaller)}"
    return f"the median delay is {seconds_in_words(median_s)}: {asked}"


def seconds_in_words(seconds: float) -> str:
    """Return a time with three digits or, from 1,000 s on, in whole seconds."""
    return f"{seconds:,.0f} s" if seconds >= 1000 else f"{seconds:.3g} s"
