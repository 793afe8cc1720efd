"""Checks of link parameters, the quantizer, and the transport delay."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cosim.core import InputError
from cosim.network import (
    DelayProfile,
    DelaySignal,
    GilbertElliott,
    Jitter,
    LossWindow,
    PacketLink,
    TransportLink,
)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"name": ""}, "name"),
        ({"sample_time_ns": 0}, "sample_time_ns"),
        ({"sample_time_ns": 0.01}, "sample_time_ns"),
        ({"sample_time_ns": True}, "sample_time_ns"),
        ({"offset_ns": -1}, "offset_ns"),
        ({"delay_ns": -1}, "delay_ns"),
        ({"delay_ns": 2**53 + 1}, "delay_ns"),
        ({"loss": 1.1}, "loss"),
        ({"loss": -0.1}, "loss"),
        ({"loss": float("nan")}, "loss"),
        ({"loss": "often"}, "loss"),
        ({"jitter": 5}, "jitter"),
        ({"order": "lifo"}, "order"),
        ({"on_loss": "repeat"}, "on_loss"),
        ({"on_loss": float("inf")}, "on_loss"),
        ({"quantization": -1.0}, "quantization"),
        ({"quantization": float("nan")}, "quantization"),
        ({"data_rate": 9600}, "data_rate"),
        ({"data_rate": 9600.0, "frame_size": 8}, "data_rate"),
        ({"data_rate": 1, "frame_size": -8}, "frame_size"),
        ({"data_rate": 1, "frame_size": 2**40}, "frame_size / data_rate"),
        ({"duplicate": 1.5}, "duplicate"),
        ({"duplicate": None}, "duplicate"),
        ({"queue_limit": 3}, "queue_limit"),
        ({"queue_limit": -1, "data_rate": 9600, "frame_size": 8}, "queue_limit"),
        ({"queue_limit": 1.0, "data_rate": 9600, "frame_size": 8}, "queue_limit"),
        ({"playout_ns": -1}, "playout_ns"),
        ({"playout_ns": 19, "delay_ns": 20}, "at least 20 ns"),
        ({"playout_ns": 19, "data_rate": 10**9, "frame_size": 20}, "at least 20 ns"),
        ({"playout_ns": 3, "delay": DelayProfile((0, 9), (7, 4))}, "at least 4 ns"),
        ({"delay": 5}, "delay"),
        ({"delay": DelaySignal(1.0), "delay_ns": 5}, "one delay"),
        ({"seed": -1}, "seed"),
        ({"seed": 2**63}, "seed"),
        ({"seed": 1.5}, "seed"),
    ],
)
def test_link_refuses(change: dict[str, Any], word: str) -> None:
    """Each bad parameter is named, with what was expected and what was got."""
    with pytest.raises(InputError, match=word) as caught:
        PacketLink(**{"name": "a", "sample_time_ns": 10} | change)
    assert caught.value.where
    assert caught.value.expected
    assert caught.value.got


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"kind": "gamma"}, "kind"),
        ({"kind": "uniform"}, "width_ns"),
        ({"kind": "uniform", "width_ns": 5, "sigma_ns": 1}, "sigma_ns"),
        ({"kind": "exponential", "mean_ns": -1}, "mean_ns"),
        ({"kind": "exponential", "mean_ns": 10, "max_ns": 9}, "max_ns"),
        ({"kind": "normal", "mean_ns": 10}, "sigma_ns"),
        ({"kind": "normal", "sigma_ns": 10, "mean_ns": 5, "max_ns": 14}, "max_ns"),
        ({"kind": "none", "width_ns": 3}, "width_ns"),
        ({"kind": "uniform", "width_ns": 3, "max_ns": 3}, "max_ns"),
    ],
)
def test_jitter_refuses(arguments: Any, word: str) -> None:
    """A jitter takes the parameters of its kind and no others."""
    with pytest.raises(InputError, match=word):
        Jitter(**arguments)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [((-1, 5, 1.0), "from_ns"), ((5, 4, 1.0), "until_ns"), ((5, 5, 1.5), "loss window: loss")],
)
def test_loss_window_refuses(arguments: tuple[int, int, float], word: str) -> None:
    """A window begins at 0 or later and does not end before it begins; it may be empty."""
    with pytest.raises(InputError, match=word):
        LossWindow(*arguments)
    assert LossWindow(5, 5, 1.0).until_ns == 5


def test_gilbert_elliott_refuses() -> None:
    """Each of the four probabilities is checked."""
    for key in ("p_enter", "p_exit", "loss_good", "loss_bad"):
        with pytest.raises(InputError, match=key):
            GilbertElliott(**{"p_enter": 0.1, "p_exit": 0.1} | {key: 2})


@given(st.lists(st.floats(-1e6, 1e6), max_size=20), st.sampled_from([0.5, 0.25, 2.0, 1.0]))
def test_quantizer(values: list[float], step: int) -> None:
    """Values go to the nearest multiple of the step, ties to even, as exact rationals say."""
    link = PacketLink("a", 1, quantization=step)
    expected = [float(round(Fraction(v) / Fraction(step)) * Fraction(step)) for v in values]
    assert link.quantize(np.array(values, np.float64)).tolist() == expected


def test_substitute() -> None:
    """The value on loss is none, 0 or the number given."""
    got = [PacketLink("a", 1, on_loss=value).substitute for value in ("hold", "zero", 2.5)]
    assert got == [None, 0.0, 2.5]


@given(
    st.lists(st.integers(1, 50), min_size=1, max_size=20),
    st.integers(0, 120),
    st.integers(-3, 3),
)
def test_transport_of_a_ramp(steps: list[int], delay: int, slope: int) -> None:
    """A ramp comes out delayed, on any points: linear interpolation is exact on it."""
    points = np.concatenate(([0], np.cumsum(steps)))
    index, weight = TransportLink("t", delay).rows(points)
    assert (index <= np.arange(points.size)).all()
    for k, t in enumerate(points.tolist()):
        i, w = int(index[k]), float(weight[k])
        assert 0.0 <= w < 1.0
        if w:
            assert i + 1 <= k
        following = points[min(i + 1, points.size - 1)]
        value = slope * ((1 - w) * int(points[i]) + w * int(following))
        assert value == pytest.approx(slope * max(t - delay, 0), abs=1e-12 * 1000)


def test_transport_without_delay_is_a_wire() -> None:
    """Zero delay reads row k at point k."""
    index, weight = TransportLink("t").rows(np.arange(0, 100, 7))
    assert index.tolist() == list(range(index.size))
    assert not weight.any()


def test_transport_refuses() -> None:
    """A transport link needs a name and a delay in whole nanoseconds."""
    for arguments in [("", 1), ("a", -1), ("a", 0.5)]:
        with pytest.raises(InputError):
            TransportLink(*arguments)
