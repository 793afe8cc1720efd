"""Logs as modems write them: the same messages as in the plain form, however written."""

from __future__ import annotations

import random
from datetime import UTC, datetime, timedelta, timezone
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
from cli.shell import cosim
from recordings.modem_logs import MODEM_LOGS, PLAIN, ModemLog

from cosim.core import InputError
from cosim.network import IN_FLIGHT_NS, DelayProfile, LogFormat, Recording, keys_of
from cosim.recordings import read_recording, read_recordings, write_recordings
from cosim.scenario import load

SECOND = 10**9
BEGIN_NS = 1_714_557_600 * SECOND
SCENARIO = """
connect = ["plant.x -> controller.x : uplink", "controller.u -> plant.u"]

[run]
end = "14 s"
step = "10 ms"

[components.plant]
fmu = "DelayedPlant"

[components.controller]
fmu = "PaperController"

[links.uplink]
kind = "packet"
sample_time = "2 s"
"""
CASES = pytest.mark.parametrize("log", MODEM_LOGS.values(), ids=MODEM_LOGS)


def written(folder: Path, text: str, name: str = "modem.log") -> Path:
    """A file with this text."""
    path = folder / name
    path.write_text(text, "utf-8")
    return path


def options(keys: dict[str, Any]) -> list[str]:
    """Keys of a format as options of a command."""
    return [word for key, value in keys.items() for word in (f"--{key.replace('_', '-')}", value)]


def table(keys: dict[str, Any]) -> str:
    """Keys of a format as an inline table of TOML."""
    entries = ", ".join(f'{key} = "{value}"' for key, value in keys.items())
    return f"format = {{ {entries} }}" if keys else ""


@CASES
def test_a_modem_log_has_the_messages_of_its_plain_form(log: ModemLog, tmp_path: Path) -> None:
    """Through Python: each instant, each delay, each loss to the nanosecond."""
    plain = read_recording(written(tmp_path, PLAIN, "plain.csv"))
    found = read_recording(written(tmp_path, log.text), log_format=LogFormat(**log.keys))
    assert found == plain
    assert found.lost.tolist() == [k in (2, 4) for k in range(8)]
    assert found.start_ns == (BEGIN_NS if log.since_1970 else 0)


@CASES
def test_commands_read_a_modem_log_by_the_same_keys(log: ModemLog, tmp_path: Path) -> None:
    """`link record` writes the plain form; it, `link show` and JSON say what was read."""
    plain = read_recording(written(tmp_path, PLAIN, "plain.csv"))
    written(tmp_path, log.text)
    given = ["link", "record", "modem.log", *options(log.keys), "-o", "out.csv"]
    done = cosim(*given, cwd=tmp_path)
    line = "8 messages over 14 s, median delay 1 s, 25 % lost"
    assert (done.code, done.err) == (0, "")
    assert f"modem.log: {line}" in done.out.splitlines()
    assert read_recording(tmp_path / "out.csv") == plain
    text = cosim("link", "show", "modem.log", *options(log.keys), cwd=tmp_path).out
    assert text.splitlines()[0] == f"modem.log: {line}"
    typed = " ".join(("cosim link fit modem.log", *options(log.keys)))
    assert typed in " ".join(text.split()), "what to do next reads the log in the same way"
    found = cosim(*given, "--json", cwd=tmp_path).json
    assert found["read"][""]["line"] == line
    assert found["read"][""]["doubts"] == []


@CASES
def test_a_scenario_reads_a_modem_log_by_the_same_keys(log: ModemLog, tmp_path: Path) -> None:
    """As a table of TOML: the scenario with the values in it is that of the plain form."""
    written(tmp_path, PLAIN, "plain.csv")
    written(tmp_path, log.text)
    keys = table(log.keys)
    read = []
    for name in ("plain.csv", f'modem.log", {keys}' if keys else "modem.log"):
        end = "" if name.endswith("}") else '"'
        text = SCENARIO + f'recording = {{ file = "{name}{end} }}\n'
        read.append(load(str(written(tmp_path, text, "one.toml"))).scenario.links["uplink"])
    assert read[0] == read[1]


def test_every_key_of_a_format_is_an_option_of_every_command_that_reads_a_log(
    tmp_path: Path,
) -> None:
    """One declaration: none is forgotten at a door."""
    verbs = [("link", verb) for verb in ("record", "show", "fit", "verdict")]
    for verb in (*verbs, ("vehicle", "fly")):
        text = cosim(*verb, "--help", cwd=tmp_path).out
        assert "How a log is written" in text
        for key in keys_of(LogFormat):
            assert f"--{key.replace('_', '-')} " in text


UNITS = {"s": 9, "ms": 6, "us": 3, "ns": 0}
NAMES = {
    "sent": ("sent", "tx", "send_time", "t_sent", "Timestamp TX", "transmitTime"),
    "received": ("delivered", "rx", "recv_time", "arrival", "Time of Arrival", "rxTime"),
    "delay": ("delay", "time_delay"),
}
BETWEEN = {",": ",", ";": ";", "tab": "\t", "space": "  "}


def number(nanoseconds: int, unit: str, decimal: str) -> str:
    """A time as a decimal number of a unit, without rounding."""
    return str(Decimal(nanoseconds).scaleb(-UNITS[unit])).replace(".", decimal)


def iso(nanoseconds: int, zone: timezone) -> str:
    """A time in ISO 8601, to the nanosecond, by a clock of a zone."""
    whole, rest = divmod(nanoseconds, SECOND)
    instant = datetime.fromtimestamp(whole, UTC).astimezone(zone)
    base, offset = instant.strftime("%Y-%m-%dT%H:%M:%S"), instant.strftime("%z")
    return f"{base}.{rest:09d}{offset[:3]}:{offset[3:]}"


@pytest.mark.parametrize("seed", range(60))
def test_a_log_written_at_random_is_read_to_the_bit(seed: int, tmp_path: Path) -> None:
    """Any delimiter, decimal mark, unit, time zone, name, order of columns, marker and offset."""
    r = random.Random(seed)  # noqa: S311 - cases, not secrets
    times = sorted(r.randrange(10**12) for _ in range(r.randint(2, 40)))
    begin = r.choice((0, BEGIN_NS, -times[-1] // 2))
    sent = [begin + t for t in times]
    delays = [r.choice((None, r.randrange(5 * SECOND))) for _ in sent]
    delimiter, unit = r.choice([*BETWEEN]), r.choice([*UNITS])
    decimal = r.choice(".,") if delimiter != "," else "."
    form = r.choice(("received", "delay"))
    offset = r.choice((0, 0, r.randrange(-SECOND, SECOND)))
    is_iso, zone = r.random() < 0.3, timezone(timedelta(minutes=15 * r.randint(-40, 40)))
    marker = r.choice(("NaN", "nan", "lost", "-", "inf", "null", "-9999", "timeout"))
    names = {role: r.choice(NAMES[role]) for role in ("sent", form)}
    if delimiter == "space":
        names = {role: name.replace(" ", "_") for role, name in names.items()}

    def cell(instant: int) -> str:
        return iso(instant, zone) if is_iso else number(instant, unit, decimal)

    columns = [names["sent"], names[form], "rssi"]
    r.shuffle(columns)
    lines = [BETWEEN[delimiter].join(columns)]
    for t, d in zip(sent, delays, strict=True):
        if d is None:
            became = marker
        elif form == "delay":
            became = number(d + offset, unit, decimal)
        else:
            became = cell(t + d + offset)
        cells = {names["sent"]: cell(t), names[form]: became, "rssi": str(r.randint(-90, -40))}
        lines.append(BETWEEN[delimiter].join(cells[name] for name in columns))
    keys: dict[str, Any] = {"unit": unit, "clock_offset_ns": offset}
    if marker in ("-9999", "timeout"):
        keys["lost"] = (marker,)
    if r.random() < 0.3:
        keys |= {"sent": names["sent"], form: names[form], "delimiter": delimiter}
        keys["decimal"] = decimal
    path = written(tmp_path, "\n".join(lines) + "\n")
    found = read_recording(path, log_format=LogFormat(**keys))
    assert (found.sent_ns + found.start_ns).tolist() == sent
    assert found.lost.tolist() == [d is None for d in delays]
    assert found.delay_ns is not None
    came = [d for d in delays if d is not None]
    assert found.delay_ns[found.arrived].tolist() == came


@pytest.mark.parametrize("seed", range(20))
def test_a_log_with_its_unit_in_the_header_needs_none(seed: int, tmp_path: Path) -> None:
    """`tx_ms`, `rx [us]`, `delay (s)`: each column in its own."""
    r = random.Random(seed)  # noqa: S311 - cases, not secrets
    one, two = r.choice([*UNITS]), r.choice([*UNITS])
    style = r.choice(("{}_{}", "{} [{}]", "{} ({})", "{}/{}"))
    rows = [(k * SECOND, r.randrange(SECOND)) for k in range(5)]
    text = f"{style.format('tx', one)};{style.format('delay', two)}\n"
    text += "".join(f"{number(t, one, '.')};{number(d, two, '.')}\n" for t, d in rows)
    found = read_recording(written(tmp_path, text))
    assert found.sent_ns.tolist() == [t for t, _ in rows]
    assert found.delay_ns is not None
    assert found.delay_ns.tolist() == [d for _, d in rows]


def test_numbers_that_are_missing_are_lost_messages(tmp_path: Path) -> None:
    """Between those beside them at equal distances, due as long after as the last that came."""
    path = written(tmp_path, "id,sent,delivered\n7,0,1\n10,6,\n11,8,8.5\n")
    found = read_recording(path, log_format=LogFormat(sequence="id"))
    assert (found.sent_ns // SECOND).tolist() == [0, 2, 4, 6, 8]
    assert found.lost.tolist() == [False, True, True, True, False]
    assert found.delay_ns is not None
    assert found.delay_ns.tolist() == [SECOND] * 4 + [SECOND // 2]


def test_minus_one_is_an_instant_where_one_can_be(tmp_path: Path) -> None:
    """A clock that begins before zero: -1 is after -2, and lost after 3, as it always was."""
    found = read_recording(written(tmp_path, "sent,delivered\n-2,-1\n3,-1\n4,in flight\n"))
    assert found.lost.tolist() == [False, True, False]
    assert found.delay_ns is not None
    assert found.delay_ns.tolist() == [SECOND, SECOND, IN_FLIGHT_NS]


def test_a_status_says_which_were_lost(tmp_path: Path) -> None:
    """In words of the modem, beside times of arrival or without them."""
    text = "tx,result\n0,OK\n2,TIMEOUT\n4,OK\n"
    keys = LogFormat(status="result", lost=("timeout",))
    alone = read_recording(written(tmp_path, text), log_format=keys)
    assert alone.delay_ns is None
    assert alone.lost.tolist() == [False, True, False]
    text = "tx,rx,result\n0,1,OK\n2,,TIMEOUT\n4,5,OK\n"
    beside = read_recording(written(tmp_path, text), log_format=keys)
    assert beside.delay_ns is not None
    assert beside.lost.tolist() == [False, True, False]


def test_losses_without_times_are_written_and_read_again(tmp_path: Path) -> None:
    """As the columns sent and lost."""
    recording = Recording([0, SECOND, 2 * SECOND], [False, True, False], None, start_ns=5)
    write_recordings(tmp_path / "out.csv", {"": recording})
    found = read_recording(tmp_path / "out.csv")
    assert found == recording
    assert found.start_ns == 5
    both = {"a": recording, "b": Recording([0], [False], [1])}
    with pytest.raises(InputError, match="with and without times"):
        write_recordings(tmp_path / "both.csv", both)


HEADER = "the header: "
MISTAKES: dict[str, tuple[str, dict[str, Any], list[str]]] = {
    "no column of sending": ("time;rx\n0;1\n", {}, [HEADER + "time;rx", "--sent time"]),
    "no name for either": ("a,b\n0,1\n", {}, [HEADER + "a,b", "--sent NAME"]),
    "two columns of sending": ("tx,t_send,rx\n0,0,1\n", {}, ["--sent tx or --sent t_send"]),
    "two columns of arrival": ("tx,rx,arrival\n0,1,1\n", {}, ["--received rx or --received arr"]),
    "nothing of arrival": ("tx,rssi\n0,1\n", {}, [HEADER + "tx,rssi", "--received NAME"]),
    "a latency": ("tx,latency\n0,1\n", {}, ["there and back", "--delay latency, if it is"]),
    "a round trip": ("tx\trtt\n0\t1\n", {}, ["--delay rtt, if it is", "half of it"]),
    "no header": ("0,1\n2,3\n", {}, ["no names of columns", "sent,received", HEADER + "0,1"]),
    "a name that is not there": ("tx,rx\n0,1\n", {"sent": "tz"}, ["no column 'tz'", "--sent tx"]),
    "another delimiter": ("tx;rx\n0;1\n", {"delimiter": ","}, ["leave the delimiter away"]),
    "both forms": ("tx,rx\n0,1\n", {"received": "rx", "delay": "rx"}, ["one of the two"]),
    "commas for both": ("tx,rx\n0,1\n", {"delimiter": ",", "decimal": ","}, ["one of the two"]),
    "a marker of its own": ("tx,rx\n0,1\n2,n/a\n", {}, ["line 3", "column rx", "--lost n/a"]),
    "zero for lost": ("tx,rx\n5,0\n7,8\n9,0\n", {}, ["--lost 0", "2 messages of 3", "line 2"]),
    "a clock behind": ("tx,rx\n5,4.5\n7,6.25\n", {}, ["--clock-offset -0.75", "by up to 0.75 s"]),
    "milliseconds since 1970": ("tx,rx\n1714557600000,1714557601002\n", {}, ["--unit ms"]),
    "nanoseconds since 1970": ("tx,rx\n1714557600000000000,1\n", {}, ["--unit ns"]),
    "points and commas": ("tx;rx\n0.5;1,5\n", {}, ["decimal commas and decimal points", "line 2"]),
    "thousands": ("tx;rx\n1.234,5;2\n", {}, ["line 2", "column tx", "'1.234,5'"]),
    "points in place of commas": ("tx;rx\n0.5;1\n", {"decimal": ","}, ["with a decimal comma"]),
    "zones and none": (
        "tx,rx\n2024-05-01T10:00:00Z,2024-05-01T10:00:01\n",
        {},
        ["with a zone and times without", "line 2"],
    ),
    "no such day": ("tx,rx\n2024-02-30T10:00:00Z,\n", {}, ["does not exist", "ISO 8601"]),
    "a time of the day alone": ("tx,rx\n10:00:00,10:00:01\n", {}, ["ISO 8601: 2024-05-01T"]),
    "cells beyond the header": ("tx rx\n2024-05-01 10:00:00 1\n", {}, ["as many cells", "2"]),
    "numbers that fall": ("id,tx,rx\n2,0,1\n1,2,3\n", {"sequence": "id"}, ["do not increase"]),
    "a sequence of something else": (
        "id,tx,rx\n2,0,1\n9999,2,3\n",
        {"sequence": "id"},
        ["nearly all", "leave the sequence away"],
    ),
    "an offset without arrivals": (
        "tx,lost\n0,1\n",
        {"clock_offset": "1"},
        ["no times of arrival", "--received NAME"],
    ),
    "an offset that is none": ("tx,rx\n0,1\n", {"clock_offset": "1 m"}, ["--clock-offset"]),
    "a status in other words": ("tx,lost\n0,yes\n", {}, ["neither lost nor not", "--lost yes"]),
    "out of order": ("tx,rx\n2,3\n0,1\n", {}, ["order of sending", "sort the rows by tx"]),
    "no lines": ("tx,rx\n", {}, ["no sample", "a line for each message"]),
    "an empty file": ("", {}, ["the file is empty"]),
}


@pytest.mark.parametrize("case", MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_an_error_that_says_what_to_do(
    case: tuple[str, dict[str, Any], list[str]], tmp_path: Path
) -> None:
    """With the header where a column is meant, and the option to give; exit code 2."""
    text, keys, words = case
    written(tmp_path, text)
    done = cosim("link", "show", "modem.log", *options(keys), cwd=tmp_path)
    assert (done.code, done.out) == (2, "")
    for word in words:
        assert word in done.err
    assert "Traceback" not in done.err


def test_messages_name_a_key_as_it_is_given_there(tmp_path: Path) -> None:
    """An option of a command, a key of a scenario, an argument in Python."""
    path = written(tmp_path, "time,rx\n0,1\n")
    assert "try: --sent time " in cosim("link", "show", "modem.log", cwd=tmp_path).err
    with pytest.raises(InputError) as refused:
        read_recording(path)
    assert refused.value.hint == "LogFormat(sent='time') names it"
    scenario = written(tmp_path, SCENARIO + 'recording = "modem.log"\n', "one.toml")
    with pytest.raises(InputError) as refused:
        load(str(scenario))
    assert refused.value.hint == 'format = { sent = "time" } names it'
    mcap = tmp_path / "x.mcap"
    mcap.write_bytes(b"\x89MCAP0\r\n")
    early = written(tmp_path, "tx,rx\n5,4.5\n", "early.log")
    with pytest.raises(InputError, match=r"LogFormat\(clock_offset_ns=-500000000\)"):
        read_recording(early)
    with pytest.raises(InputError) as refused:
        read_recording(mcap, log_format=LogFormat(unit="ms"))
    assert refused.value.hint == "leave the format away"


def even(count: int, apart: float, delay: float, spread: float = 0.01) -> str:
    """A log of messages at equal distances, whose delays differ."""
    rows = (f"{k * apart},{k * apart + delay + spread * (k % 7)}" for k in range(count))
    return "\n".join(("sent,delivered", *rows)) + "\n"


DOUBTS: dict[str, tuple[str, dict[str, Any], str]] = {
    "milliseconds": (even(20, 2000, 1002), {}, "the median delay is 1,002 s: are these milliseco"),
    "milliseconds apart": (even(20, 2000, 2), {}, "messages are 2,000 s apart (median): are these"),
    "microseconds": (even(20, 2e6, 1e6), {"unit": "ms"}, "are these microseconds? give --unit us"),
    "all lost": ("tx,rx\n0,nan\n2,nan\n", {}, "all messages are lost"),
    "a short log": (even(20, 0.002, 0.001, 1e-6), {}, "all messages were sent within 0.038 s"),
    "seconds": (even(20, 2, 1), {"unit": "ms"}, "within 0.038 s: are these seconds? give --unit s"),
    "equal delays": (even(20, 2, 1.5, 0.0), {}, "all delays are 1.5 s"),
    "hours": (
        "tx,rx\n2024-05-01T10:00:00Z,2024-05-01T12:00:01Z\n",
        {},
        "are both times of one clock, and of one time zone?",
    ),
    "rows that are not there": (
        "seq,tx,rx\n1,0,1\n2,2,3\n3,4,5\n5,8,9\n",
        {},
        "lost messages without a row? give --sequence seq",
    ),
    "arrivals not read": ("sent,lost,rx\n0,0,1\n2,0,3\n", {}, "is rx one? give --received rx"),
    "decimal commas between commas": ("sent,delivered\n0,5,1,5\n2,5,3,5\n", {}, "more cells than"),
}


@pytest.mark.parametrize("case", DOUBTS.values(), ids=DOUBTS)
def test_what_looks_wrong_is_asked(case: tuple[str, dict[str, Any], str], tmp_path: Path) -> None:
    """On standard error and in JSON; the answer is given all the same."""
    text, keys, words = case
    written(tmp_path, text)
    done = cosim("link", "show", "modem.log", *options(keys), cwd=tmp_path)
    assert done.code == 0
    assert words in done.err
    found = cosim("link", "show", "modem.log", *options(keys), "--json", cwd=tmp_path).json
    assert any(words in doubt for doubt in found["read"][""]["doubts"])


def test_a_delay_of_1002_seconds_never_passes_without_a_word(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Python, a scenario's recording, its delay over time: each says what would mend it."""
    path = written(tmp_path, even(20, 2000, 1002))
    words = "the median delay is 1,002 s: are these milliseconds? give "
    assert read_recordings(path)[""].greatest_ns > 1000 * SECOND
    assert f"{path}: {words}LogFormat(unit='ms')" in capsys.readouterr().err
    recorded = SCENARIO + 'recording = { file = "modem.log", replay = "loop", rows = "message" }\n'
    load(str(written(tmp_path, recorded, "one.toml")))
    assert f'{words}format = {{ unit = "ms" }}' in capsys.readouterr().err
    profile = written(tmp_path, even(20, 2000, 0).replace("delivered", "x") + "\n", "p.csv")
    profile.write_text("time;delay\n0;1002\n2000;1003\n4000;1001\n", "utf-8")
    over_time = SCENARIO + 'delay = { file = "p.csv" }\n'
    load(str(written(tmp_path, over_time, "two.toml")))
    assert f'{words}format = {{ unit = "ms" }}' in capsys.readouterr().err
    mended = SCENARIO + 'delay = { file = "p.csv", format = { unit = "ms" } }\n'
    part: Any = load(str(written(tmp_path, mended, "three.toml"))).scenario.links["uplink"].delay
    assert (part.times, part.delays) == ([0.0, 2.0, 4.0], [1.002, 1.003, 1.001])
    assert capsys.readouterr().err == ""
    with pytest.raises(InputError, match="a delay over time has no messages"):
        DelayProfile.from_csv(profile, log_format=LogFormat(sent="time"))
