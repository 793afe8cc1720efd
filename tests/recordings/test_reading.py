"""Recordings read from files: what is in them comes out, and what is wrong is named."""

from __future__ import annotations

import csv
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

from cosim.core import InputError
from cosim.network import IN_FLIGHT_NS, PacketLink, Recording, deliver
from cosim.recordings import (
    MOST_ROWS,
    read_recording,
    read_recordings,
    statistics_of,
    write_recordings,
)


def written(folder: Path, text: str) -> Path:
    """A file with this text."""
    path = folder / "log.csv"
    path.write_text(text, "utf-8")
    return path


def test_columns_in_any_order_by_any_clock(tmp_path: Path) -> None:
    """Seconds since 1970, to the nanosecond; comments, other columns, both ways to say lost."""
    path = written(
        tmp_path,
        "delivered,note,sent\n"
        "1568592000.123456789,a,1568592000\n"
        "# a comment\n\n"
        "lost,b,1568592002\n"
        ",c,1568592004.000000001\n"
        "in flight,d,1568592006\n",
    )
    found = read_recording(path)
    assert found.start_ns == 1_568_592_000 * 10**9
    assert found.sent_ns.tolist() == [0, 2 * 10**9, 4 * 10**9 + 1, 6 * 10**9]
    assert found.lost.tolist() == [False, True, True, False]
    assert found.delay_ns is not None
    assert found.delay_ns.tolist() == [123_456_789] * 3 + [IN_FLIGHT_NS]


def test_when_a_lost_message_was_due(tmp_path: Path) -> None:
    """As the file says, or as long after its sending as the last one that came before it."""
    path = written(tmp_path, "sent,delivered,due\n0,,\n1,1.5,\n2,,2.25\n3,,\n4,5,\n5,,\n")
    found = read_recording(path)
    assert found.delay_ns is not None
    assert (found.delay_ns / 1e9).tolist() == [0.5, 0.5, 0.25, 0.25, 1.0, 1.0]


def test_other_forms_say_the_same(tmp_path: Path) -> None:
    """Delays in place of instants; a column `lost` beside them; or that alone, without times."""
    one = read_recording(written(tmp_path, "sent,delivered\n10,10.5\n12,\n14,14.25\n"))
    for text in (
        "sent,delay\n10,.5\n12,lost\n14,0.25\n",
        "sent,lost,delay\n10,0,.5\n12,true,\n14,,0.25\n",
    ):
        assert read_recording(written(tmp_path, text)) == one
    alone = read_recording(written(tmp_path, "sent,lost\n10,0\n12,1\n14,\n"))
    assert alone.delay_ns is None
    assert alone.lost.tolist() == one.lost.tolist()


def test_several_links_in_one_file(tmp_path: Path) -> None:
    """By name; none is taken silently."""
    path = written(tmp_path, "node,sent,delivered\nb,0,1\na,5,\nb,2,\na,7,7.5\n")
    found = read_recordings(path)
    assert list(found) == ["b", "a"]
    assert found["a"].lost.tolist() == [True, False]
    assert read_recording(path, "b") == found["b"]
    assert read_recording(path, default="a") == found["a"]
    for node, words in ((None, "b, a"), ("c", "no node 'c'")):
        with pytest.raises(InputError, match=words):
            read_recording(path, node, default="x")


def test_places_become_ranges(tmp_path: Path) -> None:
    """A range in metres, or the places of both ends."""
    text = "sent,lost,from.x,from.y,to.x,to.y,size\n0,0,0,0,3,4,64\n1,1,1,1,1,1,32\n"
    found = read_recording(written(tmp_path, text))
    assert found.range_m is not None
    assert found.range_m.tolist() == [5.0, 0.0]
    assert found.size is not None
    assert found.size.tolist() == [64.0, 32.0]
    found = read_recording(written(tmp_path, "sent,lost,range\n0,0,120.5\n"))
    assert found.range_m is not None
    assert found.range_m.tolist() == [120.5]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["the file is empty", "'sent'"]),
        ("time,delivered\n0,1\n", ["line 1", "no column says when", "LogFormat(sent='time')"]),
        ("sent,sent,delivered\n0,0,1\n", ["several columns 'sent'"]),
        ("sent,delivered,delivered\n0,0,1\n", ["several columns 'delivered'"]),
        ("sent,arrived\n0,1\n", ["no column says what became", "delivered"]),
        ("sent,delivered\n", ["no sample"]),
        ("sent,delivered\n0,1\nx,2\n", ["line 3", "column sent", "'x'"]),
        ("sent,delivered\n0,1\n,2\n", ["line 3", "column sent", "nothing"]),
        ("sent,delivered\nnan,1\n", ["line 2", "column sent", "out of range"]),
        ("sent,delivered\n0,soon\n", ["line 2", "column delivered", "'soon'"]),
        ("sent,delivered\n0,1\n5,4.9\n", ["line 3", "column delivered", "before it is sent", "5"]),
        ("sent,delay\n0,-2\n", ["line 2", "column delay", "before it is sent"]),
        ("sent,delivered,due\n5,,4\n", ["line 2", "column due", "before it is sent"]),
        ("sent,delivered\n0,1\n2,3\n1,2\n", ["line 4", "column sent", "order", "2.0", "sort"]),
        ("sent,delivered,lost\n0,1,1\n", ["line 2", "column lost", "contradict"]),
        ("sent,delivered,lost\n0,,0\n", ["line 2", "column lost", "contradict"]),
        ("sent,lost\n0,maybe\n", ["line 2", "column lost", "'maybe'"]),
        ("sent,lost,range\n0,1,far\n", ["line 2", "column range", "'far'"]),
        ("sent,lost,range\n0,1,nan\n", ["line 2", "column range", "finite"]),
        ("sent,lost,node\n0,1,\n", ["line 2", "column node", "without its node"]),
        ("sent,delivered\n1e30,2e30\n", ["line 2", "column sent", "out of range"]),
        ('sent,delivered\n0,"1\n', ["not CSV"]),
        ("sent,delivered\n0," + "1" * 200_000 + "\n", ["not CSV", "line"]),
        ("sent,delivered\n0,200000000\n", ["out of order or out of range", "message 0"]),
    ],
)
def test_a_bad_file_is_refused_with_line_and_column(
    tmp_path: Path, text: str, words: list[str]
) -> None:
    """Each message says where, what was expected and what was found."""
    with pytest.raises(InputError) as refused:
        read_recordings(written(tmp_path, text))
    for word in words:
        assert word in str(refused.value)
    assert refused.value.exit_code == 2


def test_a_file_that_is_none_is_refused(tmp_path: Path) -> None:
    """Not there, a folder, bytes that are no text, and a trace that is cut short."""
    other = tmp_path / "other.csv"
    other.write_bytes(b"sent,delivered\n\xff,1\n")
    short = tmp_path / "short.mcap"
    short.write_bytes(b"\x89MCAP0\r\n")
    for path in (tmp_path / "none.csv", tmp_path, other, short):
        with pytest.raises(Exception, match=path.name) as refused:
            read_recordings(path)
        assert hasattr(refused.value, "exit_code")


def test_too_many_rows_are_refused_before_they_fill_the_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the first row beyond the limit."""
    assert MOST_ROWS == 2_000_000
    monkeypatch.setattr("cosim.recordings.reading.MOST_ROWS", 3)
    path = written(tmp_path, "sent,lost\n" + "".join(f"{k},0\n" for k in range(9)))
    with pytest.raises(InputError, match="line 5"):
        read_recordings(path)


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    """To the nanosecond, with names that CSV has to quote."""
    flight = Recording([0, 7, 7], [0, 1, 0], [5, 3, IN_FLIGHT_NS], start_ns=-3)
    later = Recording([0, 10**9 + 1], [0, 0], [0, 2**52], start_ns=2**60)
    several = {'a "b", c': flight, "d": later}
    path = tmp_path / "out.csv"
    for given in (several, {"": flight}):
        write_recordings(path, given)
        found = read_recordings(path)
        assert found == given
        assert [each.start_ns for each in found.values()] == [e.start_ns for e in given.values()]


def test_a_recording_that_cannot_be_written_is_an_error_that_names_it(tmp_path: Path) -> None:
    """Below a file there are no files; it was an `OSError` of the system."""
    (tmp_path / "file").write_text("", "utf-8")
    path = tmp_path / "file" / "out.csv"
    with pytest.raises(InputError, match="the recording cannot be written") as caught:
        write_recordings(path, {"": Recording([0], [0], [5])})
    assert caught.value.where == str(path)


def test_another_mcap_file_is_read_by_its_sequence_numbers(tmp_path: Path) -> None:
    """Publish time is sending, log time arrival; numbers 6 and 7 are missing: lost."""
    path = tmp_path / "modem.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("ping", "jsonschema", b"{}")
        topics = [writer.register_channel(t, "json", schema) for t in ("/pings", "/status")]
        for number, sent, at in ((5, 100, 130), (9, 500, 540), (8, 400, 450)):
            writer.add_message(topics[0], at, b"{}", sent, number)
        for at in (100, 200):
            writer.add_message(topics[1], at, b"{}", at, 0)
        writer.finish()
    found = read_recordings(path)
    assert list(found) == ["/pings"]
    assert found["/pings"].start_ns == 100
    assert found["/pings"].sent_ns.tolist() == [0, 100, 200, 300, 400]
    assert found["/pings"].lost.tolist() == [False, True, True, False, False]
    delay = found["/pings"].delay_ns
    assert delay is not None
    assert delay.tolist() == [30, 30, 30, 50, 40]


def test_replay_is_what_an_independent_loop_does(tmp_path: Path) -> None:
    """A log read by `csv` and `Decimal`, message by message: the newest that came is in use."""
    random = np.random.default_rng(5)
    lines, t = ["sent,delivered"], Decimal("1000.25")
    for _ in range(300):
        came = t + Decimal(int(random.integers(0, 5 * 10**9))) / 10**9
        lines.append(f"{t},{'' if random.random() < 0.4 else came}")
        t += 2
    path = written(tmp_path, "\n".join(lines) + "\n")
    link = PacketLink("up", 2 * 10**9, recording=read_recording(path))
    end = 598 * 10**9
    arrivals: list[tuple[int, int]] = []
    with path.open(encoding="utf-8") as file:
        for k, row in enumerate(csv.DictReader(file)):
            if row["delivered"]:
                at = Decimal(row["delivered"]) - Decimal(row["sent"])
                arrivals.append((2 * 10**9 * k + int(at * 10**9), k))
    found = deliver(link, end)
    for instant in range(0, end, 10**9 // 4):
        newest = max((k for at, k in arrivals if at <= instant), default=-1)
        assert found.state(instant).sequence == newest


def test_statistics_by_hand() -> None:
    """Ten messages each second; runs, transitions, delays, ages and outages counted by hand."""
    lost = [0, 1, 1, 1, 0, 0, 1, 0, 0, 0]
    delay = [500, 0, 0, 0, 250, 250, 0, 1500, 500, 500]
    sent = np.arange(10) * 10**9
    found = statistics_of(Recording(sent, np.array(lost, bool), np.array(delay) * 10**6))
    assert (found.messages, found.arrived, found.lost, found.loss) == (10, 6, 4, 0.4)
    assert found.loss_after_loss == 2 / 4
    assert found.loss_after_arrival == 2 / 5
    assert found.runs_of_losses == {1: 1, 3: 1}
    assert found.runs_of_arrivals == {1: 1, 2: 1, 3: 1}
    assert found.outages_s == [(1.0, 3.0)]
    assert found.delay_s is not None
    assert (found.delay_s.least, found.delay_s.greatest) == (0.25, 1.5)
    # arrivals at .5, 4.25, 5.25, 8.5 (both 7 and 8), 9.5; in use 0, 4, 5, 8
    assert found.greatest_age_s == 4.25
    area = (4.25**2 - 0.5**2 + 1.25**2 - 0.25**2 + 3.5**2 - 0.25**2 + 1.5**2 - 0.5**2) / 2
    assert found.mean_age_s == pytest.approx(area / 9)


def test_statistics_of_little() -> None:
    """One message, all lost, all in flight: nothing divides by zero."""
    one = statistics_of(Recording([0], [1], [0]))
    assert (one.loss, one.loss_after_loss, one.interval_s, one.mean_age_s) == (
        1.0,
        None,
        None,
        None,
    )
    flight = statistics_of(Recording([0, 1], [0, 0], [-1, -1]))
    assert (flight.loss, flight.delay_s, flight.runs_of_losses) == (None, None, {})
