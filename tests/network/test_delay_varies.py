"""Delays that vary: recorded ones, in memory and in files, and those that follow a signal."""

from __future__ import annotations

import pickle
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cosim.core import InputError
from cosim.network import (
    MAX_NS,
    DelayProfile,
    DelaySignal,
    PacketLink,
    TransportLink,
    deliver,
)


def test_profile_by_hand() -> None:
    """The end values hold outside; between the samples the last one, or the line."""
    times, delays = np.array([10, 20, 40]), np.array([100, 200, 50])
    at = [-5, 0, 10, 15, 19, 20, 25, 40, 1000]
    delays_at = DelayProfile(times, delays).delay_ns(at).tolist()
    assert delays_at == [100, 100, 100, 100, 100, 200, 200, 50, 50]
    line = DelayProfile(times, delays, "linear").delay_ns(at).tolist()
    assert line == [100, 100, 100, 150, 190, 200, 162, 50, 50]  # 162.5 to the even one
    assert DelayProfile(times[:1], delays[:1], "linear").delay_ns(at).tolist() == [100] * 9
    assert DelayProfile(times, delays).delay_ns([[19], [20]]).tolist() == [[100], [200]]


@given(
    st.lists(st.integers(-MAX_NS, MAX_NS), min_size=2, max_size=6, unique=True),
    st.data(),
)
def test_line_is_exact_at_every_size(times: list[int], data: st.DataObject) -> None:
    """Between samples up to 2**53 apart the line is that of fractions, rounded once."""
    times = sorted(times)
    delays = [data.draw(st.integers(0, MAX_NS)) for _ in times]
    k = data.draw(st.integers(0, len(times) - 2))
    t = data.draw(st.integers(times[k], times[k + 1]))
    rise = Fraction((delays[k + 1] - delays[k]) * (t - times[k]), times[k + 1] - times[k])
    profile = DelayProfile(np.array(times), np.array(delays), "linear")
    assert profile.delay_ns(t) == round(delays[k] + rise)


def test_profiles_compare_by_value_and_are_read_only() -> None:
    """Profiles of the same samples are equal, cannot be written to, and survive pickling."""
    times = np.array([0, 10])
    one, other = (DelayProfile(times, np.array([5, d])) for d in (6, 7))
    same = DelayProfile(times.tolist(), [5, 6])
    assert one == same == pickle.loads(pickle.dumps(one))  # noqa: S301 - our own
    assert hash(one) == hash(same)
    assert one != other
    assert one != 5
    times[1] = 99
    assert one == same
    with pytest.raises(ValueError, match="read-only"):
        one.delays_ns[0] = 1
    assert PacketLink("a", 1, delay=one) == PacketLink("a", 1, delay=same)


def test_profile_from_seconds() -> None:
    """Seconds are rounded to the nearest nanosecond."""
    profile = DelayProfile.from_seconds([0.0, 0.1], [1e-9, 2.4e-9], "linear")
    assert profile.times_ns.tolist() == [0, 100_000_000]
    assert profile.delays_ns.tolist() == [1, 2]


@pytest.mark.parametrize(
    ("times", "delays", "way", "word"),
    [
        ([], [], "previous", "at least one"),
        ([0.0], [1], "previous", "integer"),
        ([[0]], [[1]], "previous", "in one dimension"),
        ([0, 1], [1], "previous", "one delay for each"),
        ([0, 0], [1, 1], "previous", r"times_ns\[1\]"),
        ([0, 5, 4], [1, 1, 1], "previous", "more than 5 ns"),
        ([0, 1], [1, -1], "previous", r"delays_ns\[1\].*out of range"),
        ([0, 2**54], [1, 1], "previous", r"times_ns\[1\].*out of range"),
        ([0], [1], "cubic", "interpolation"),
        (["a"], [1], "previous", "integer"),
    ],
)
def test_profile_refuses(times: Any, delays: Any, way: Any, word: str) -> None:
    """An invalid profile is refused, and the sample named."""
    with pytest.raises(InputError, match=word):
        DelayProfile(np.array(times), np.array(delays), way)


@pytest.mark.parametrize(
    ("times", "delays", "word"),
    [
        ([0.0, float("nan")], [0, 0], r"times_s\[1\]"),
        ([0.0, 1.0], [0, float("inf")], r"delays_s\[1\]"),
        ([1.7e9], [0.1], "start of the run"),
        (["noon"], [0.1], "numbers"),
        ([0.0, 1e-12], [0.1, 0.1], "increase"),
    ],
)
def test_profile_from_seconds_refuses(times: Any, delays: Any, word: str) -> None:
    """A value that is not a number or out of range is refused, and the sample named."""
    with pytest.raises(InputError, match=word):
        DelayProfile.from_seconds(times, delays)


def test_profile_from_a_file(tmp_path: Path) -> None:
    """Other columns, comments, empty lines and blanks are passed over; decimals are exact."""
    path = tmp_path / "range.csv"
    path.write_text(
        "\ufeff# recorded on the quay\n"
        'quality, time ,"delay"\n'
        "good,-0.5,0.25\n"
        "\n"
        "# a gap\n"
        " bad , 0.1 , 1e-1 \r\n"
        "good,8388608.000000001,0.0000000005\n",
        encoding="utf-8",
    )
    profile = DelayProfile.from_csv(path, interpolation="linear")
    assert profile.times_ns.tolist() == [-500_000_000, 100_000_000, 8388608 * 10**9 + 1]
    assert profile.delays_ns.tolist() == [250_000_000, 100_000_000, 0]  # a half, to the even one
    assert profile.interpolation == "linear"


def test_profile_from_other_columns(tmp_path: Path) -> None:
    """The two columns may have any names."""
    path = tmp_path / "a.csv"
    path.write_text("t [s],tau\n0,1\n1,2\n")
    profile = DelayProfile.from_csv(path, time="t [s]", delay="tau")
    assert profile == DelayProfile.from_seconds([0, 1], [1, 2])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", ["empty", "'time'"]),
        (b"\n\n", ["empty"]),
        (b"time,dely\n0,1\n", ["line 1", "'delay'", "did you mean dely"]),
        (b"time,delay,delay\n0,1,1\n", ["several columns 'delay'"]),
        (b"time,delay\n", ["no sample"]),
        (b"time,delay\n0,1\n1\n", ["line 3", "column delay", "nothing"]),
        (b"time,delay\n0,1\n1,fast\n", ["line 3", "column delay", "'fast'"]),
        (b"time,delay\n0,1\n\n# x\n1,0x5\n", ["line 5", "column delay"]),
        (b"time,delay\n0,1\n0,1\n", ["line 3", "column time", "increase", "more than 0"]),
        (b"time,delay\n0,1\n1,-0.1\n", ["line 3", "column delay", "cannot be negative", "-0.1 s"]),
        (b"time,delay\n0,nan\n", ["line 2", "column delay", "out of range"]),
        (b"time,delay\n0,inf\n", ["line 2", "column delay", "out of range"]),
        (b"time,delay\n1e999999999,1\n", ["line 2", "column time", "out of range"]),
        (b"time,delay\n0,1e9999999999999999999\n", ["line 2", "column delay"]),
        (b"time,delay\n1700000000,1\n", ["column time", "start of the run"]),
        (b"time,delay\n0," + b"1" * 500 + b"\n", ["line 2", "column delay", "not a number"]),
        (b'time,delay\n"0,1\n', ["not CSV"]),
        (b"time,delay\n\xff\xfe,1\n", ["not text", "UTF-8"]),
    ],
)
def test_bad_file_is_named_with_line_and_column(
    tmp_path: Path, content: bytes, words: list[str]
) -> None:
    """Each message says file, line and column, what was expected and what was found."""
    path = tmp_path / "delay.csv"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        DelayProfile.from_csv(path)
    for word in ["delay.csv", *words]:
        assert word in str(caught.value)


def test_tiny_numbers_in_a_file_are_zero(tmp_path: Path) -> None:
    """A delay far below a nanosecond is read quickly, as 0."""
    path = tmp_path / "delay.csv"
    path.write_text("time,delay\n0,1e-999999999\n1,1e-9\n")
    assert DelayProfile.from_csv(path).delays_ns.tolist() == [0, 1]


def test_missing_file_is_refused(tmp_path: Path) -> None:
    """A missing file and a folder are refused by name."""
    for path in (tmp_path / "none.csv", tmp_path):
        with pytest.raises(InputError, match=path.name):
            DelayProfile.from_csv(path)


@pytest.mark.parametrize(
    ("scale", "offset", "value", "delay"),
    [
        (1 / 1500, 0, 1500, 10**9),
        (1 / 1500, 7, 750.0, 500_000_007),
        (1 / 1500, 5, 0.0, 5),
        (-1.0, 10**9, 0.25, 750_000_000),
        (0.0, 12, 1e300, 12),
        (2.0**-10, 0, 1, 976_562),  # 976562.5, to the even one
        (2.0**-10, 1, 1, 976_564),  # 976563.5
        (2.0**-10, 0, np.float32(3), 2_929_688),  # 2929687.5
        (1e-300, 3, 1e-300, 3),
        (1.0, 0, 9_000_000, 9 * 10**15),
    ],
)
def test_delay_that_follows_a_signal(scale: float, offset: int, value: Any, delay: int) -> None:
    """Offset + scale * value, exactly, and rounded once."""
    assert DelaySignal(scale, offset).delay_ns(value) == delay


@given(st.floats(0, 1e-2), st.floats(0, 1e6), st.integers(0, 10**12))
def test_delay_of_a_signal_is_exact(scale: float, value: float, offset: int) -> None:
    """The delay is that of fractions, rounded once."""
    exact = offset + Fraction(scale) * Fraction(value) * 10**9
    assert DelaySignal(scale, offset).delay_ns(value) == round(exact)


@pytest.mark.parametrize(
    ("value", "word"),
    [
        (float("nan"), "finite"),
        (float("inf"), "finite"),
        ("far", "finite"),
        (None, "finite"),
        (True, "finite"),
        (10**400, "finite"),
        (-1.0, "out of range"),
        (1e9, "out of range"),
        (1e308, "out of range"),
    ],
)
def test_delay_of_a_signal_refuses(value: Any, word: str) -> None:
    """A value that gives no valid delay is refused, and named."""
    with pytest.raises(InputError, match=word) as caught:
        DelaySignal(1.0).delay_ns(value, where="link 'up', message 3")
    assert "link 'up', message 3" in str(caught.value)
    assert repr(value)[:20] in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [((float("nan"),), "scale"), (("1",), "scale"), ((1.0, -1), "offset_ns"), ((1, 0.5), "offset")],
)
def test_signal_refuses(arguments: Any, word: str) -> None:
    """Scale and offset are checked where they are declared."""
    with pytest.raises(InputError, match=word):
        DelaySignal(*arguments)


def test_deliver_refuses_a_delay_that_follows_a_signal() -> None:
    """A delay that depends on the run is refused before it, with a hint."""
    with pytest.raises(InputError, match=r"follows a signal(.|\n)*Delivery"):
        deliver(PacketLink("a", 10, delay=DelaySignal(1.0)), 100)


def test_transport_with_a_recorded_delay() -> None:
    """The signal comes out delayed by what is recorded at the instant of receiving."""
    profile = DelayProfile(np.array([0, 40]), np.array([0, 20]), "linear")
    points = np.arange(0, 61, 10)
    index, weight = TransportLink("t", delay=profile).rows(points)
    read = [0, 5, 10, 15, 20, 30, 40]  # t - t/2 up to 40
    assert (points[index] + weight * 10).tolist() == read
    assert TransportLink("t", delay=profile).state(points).age_s.tolist() == [
        (t - r) / 1e9 for t, r in zip(points.tolist(), read, strict=True)
    ]
    for arguments in ({"delay": DelaySignal(1.0)}, {"delay": profile, "delay_ns": 1}):
        with pytest.raises(InputError, match="delay"):
            TransportLink("t", **arguments)
