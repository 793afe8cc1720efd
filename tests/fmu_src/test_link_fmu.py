"""A link FMU draws, delays, loses and orders as the project's own links do."""

from __future__ import annotations

import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from link_runs import INITIAL, VARIABLES, Channel, build, expected, signal
from shared import sampled, share_of
from ssp.archives import export

from cosim.core import InputError
from cosim.network import (
    QUEUE_FULL,
    GilbertElliott,
    Jitter,
    LossChain,
    PacketLink,
    TransportLink,
    deliver,
)

MS = 1_000_000
STEP = 50 * MS
STEPS = 400
BURSTS = GilbertElliott(0.1, 0.3, 0.02, 0.9)
CROSSING = GilbertElliott(0.7, 0.6, 0.0, 1.0)

LINKS = {
    "constant": {"delay_ns": 250 * MS},
    "less than a step": {"delay_ns": 1},
    "offset": {"delay_ns": 70 * MS, "offset_ns": 333 * MS},
    "faster than the step": {"delay_ns": 120 * MS, "sample_time_ns": 20 * MS},
    "off the grid": {"delay_ns": 123_456_789, "sample_time_ns": 70_000_001},
    "uniform": {"delay_ns": 90 * MS, "jitter": Jitter("uniform", width_ns=400 * MS)},
    "exponential": {"delay_ns": 60 * MS, "jitter": Jitter("exponential", mean_ns=150 * MS)},
    "bounded": {
        "delay_ns": 60 * MS,
        "jitter": Jitter("exponential", mean_ns=150 * MS, max_ns=200 * MS),
    },
    "normal": {"delay_ns": 60 * MS, "jitter": Jitter("normal", mean_ns=100 * MS, sigma_ns=80 * MS)},
    "half normal": {
        "delay_ns": 60 * MS,
        "jitter": Jitter("normal", sigma_ns=100 * MS, max_ns=120 * MS),
    },
    "lossy": {"delay_ns": 90 * MS, "loss": 0.3},
    "all lost": {"delay_ns": 90 * MS, "loss": 1.0, "on_loss": 5.5},
    "bursts": {"delay_ns": 90 * MS, "loss": BURSTS, "on_loss": "zero"},
    "crossing bursts": {"delay_ns": 90 * MS, "loss": CROSSING},
    "copies": {
        "delay_ns": 90 * MS,
        "duplicate": 0.4,
        "loss": 0.2,
        "jitter": Jitter("uniform", width_ns=300 * MS),
    },
    "played out": {
        "delay_ns": 90 * MS,
        "playout_ns": 333 * MS,
        "jitter": Jitter("uniform", width_ns=300 * MS),
        "loss": 0.1,
        "duplicate": 0.3,
        "on_loss": 5.5,
    },
    "quantized": {"delay_ns": 90 * MS, "quantization": 0.01},
    "slow": {"delay_ns": 90 * MS, "data_rate": 1000, "frame_size": 103},
    "odd rate": {"delay_ns": 90 * MS, "data_rate": 9_999_991, "frame_size": 1_234_567},
}


def packet_parameters(link: PacketLink) -> dict[str, float]:
    """The values of a link as its FMU takes them, whole numbers for Integers."""
    return {v.name: v.start for v in VARIABLES.packet_parameters(link)}


@pytest.fixture(scope="module")
def channel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A link FMU called uplink, whose parameters the tests set."""
    link = PacketLink("uplink", 100 * MS, delay_ns=100 * MS)
    return build(link, tmp_path_factory.mktemp("channel"), STEP)


@pytest.mark.parametrize("order", ["newest-wins", "fifo", "as-arrived"])
@pytest.mark.parametrize("case", sampled(LINKS, 8))
def test_link_fmu_is_the_link_on_the_grid(channel: Path, case: str, order: str) -> None:
    """Values, age, sequence numbers and drops, bit for bit."""
    changed = {"sample_time_ns": 80 * MS, "seed": 11, "order": order} | LINKS[case]
    link = PacketLink("uplink", **changed)  # type: ignore[arg-type]
    values, state = expected(link, STEP, STEPS)
    parameters = packet_parameters(link)
    with Channel(channel) as raw:
        raw.begin(parameters)
        assert raw.row() == [*INITIAL, 0.0, -1, 0]
        rows = raw.run(STEP, 0, STEPS)
    assert np.array_equal(rows[:, :2], values[1:])
    assert np.array_equal(rows[:, 2], state.age_s[1:])
    assert np.array_equal(rows[:, 3], state.sequence[1:])
    assert np.array_equal(rows[:, 4], state.dropped[1:])
    assert np.unique(values[:, 0]).size > 30 or case in ("all lost", "odd rate", "slow")


CHAIN = LossChain(((0.8, 0.15, 0.05), (0.3, 0.6, 0.1), (0.0, 0.1, 0.9)), (0.0, 0.4, 1.0))


@pytest.mark.slow
def test_a_link_fmu_has_the_chain_of_its_link(tmp_path: Path) -> None:
    """Three states draw what the project's own link draws, bit for bit, over a saved state too."""
    link = PacketLink("uplink", 30 * MS, delay_ns=90 * MS, loss=CHAIN, on_loss="zero", seed=4)
    values, state = expected(link, STEP, STEPS)
    with Channel(build(link, tmp_path, STEP)) as raw:
        raw.begin()
        rows = raw.run(STEP, 0, 150)
        saved = raw.saved()
        raw.run(STEP, 150, 190)
        raw.resume(saved)
        rows = np.concatenate([rows, raw.run(STEP, 150, STEPS)])
    assert np.array_equal(rows[:, :2], values[1:])
    assert np.array_equal(rows[:, 4], state.dropped[1:])
    assert state.dropped[-1] > 100


def test_a_chain_that_leaves_a_state_too_often_is_refused(tmp_path: Path) -> None:
    """Parameters may be set: their sum from one state is checked."""
    link = PacketLink("uplink", 30 * MS, delay_ns=90 * MS, loss=CHAIN)
    with Channel(build(link, tmp_path, STEP)) as raw:
        with pytest.raises(Exception, match="status"):
            raw.begin({"loss.move[2,1]": 0.95})
        assert "loss.move[2,...] must add to at most 1" in raw.messages


def test_full_queue_refuses_as_the_link_does(channel: Path) -> None:
    """What is refused is counted with the next output, and never comes."""
    link = PacketLink(
        "uplink", 80 * MS, delay_ns=30 * MS, data_rate=1000, frame_size=150, queue_limit=2
    )
    values, state = expected(link, STEP, STEPS)
    with Channel(channel) as raw:
        rows = raw.begin(packet_parameters(link)).run(STEP, 0, STEPS)
    assert np.array_equal(rows[:, :2], values[1:])
    assert np.array_equal(rows[:, 3], state.sequence[1:])
    assert np.array_equal(rows[1:, 4], state.dropped[1:-1])
    assert rows[-1, 4] > 100


def random_link(number: int) -> PacketLink:
    """Any link that an FMU can be, in milliseconds or off them."""
    r = random.Random(number)  # noqa: S311 - cases, not secrets
    unit = r.choice([MS, MS, 1_000_003, 37_123_457])
    p = [r.choice([0.0, 0.2, 0.5, 1.0, r.random()]) for _ in range(4)]
    mean, sigma = r.randint(0, 200) * unit, r.randint(1, 200) * unit
    greatest = r.choice([None, (mean + sigma) * r.randint(1, 3)])
    kinds = (
        Jitter(),
        Jitter("uniform", width_ns=sigma),
        Jitter("exponential", mean_ns=sigma, max_ns=greatest),
        Jitter("normal", mean_ns=mean, sigma_ns=sigma, max_ns=greatest),
    )
    rate: dict[str, Any] = {}
    if r.random() < 0.5:
        rate = {"data_rate": r.randint(500, 10**6), "frame_size": r.randint(1, 500)}
        rate["queue_limit"] = r.choice([None, 0, 1, r.randint(0, 5)])
    link = PacketLink(
        "uplink",
        sample_time_ns=r.randint(1, 120) * unit,
        offset_ns=r.choice([0, 0, r.randint(0, 300) * unit]),
        delay_ns=r.choice([1, r.randint(1, 300) * unit]),
        jitter=r.choice(kinds),
        loss=r.choice([0.0, 0.3, 1.0, GilbertElliott(*p)]),
        duplicate=r.choice([0.0, 0.0, 0.3, 1.0]),
        order=r.choice(["newest-wins", "fifo", "as-arrived"]),
        on_loss=r.choice(["hold", "zero", 2.5]),
        quantization=r.choice([0.0, 0.0, 0.01]),
        seed=r.randrange(2**31),
        **rate,
    )
    late = r.choice([None, None, 0, r.randint(0, 300) * unit])
    return link if late is None else replace(link, playout_ns=link.least_transit_ns + late)


def check_random_links(channel: Path, numbers: range) -> None:
    """Outputs, age, sequence and drops of random links, bit for bit."""
    steps = 60
    for number in numbers:
        link = random_link(number)
        values, state = expected(link, STEP, steps)
        _, sent, _, status = deliver(link, STEP * steps, STEP).arrivals()
        refused = sent[status == QUEUE_FULL]
        with Channel(channel) as raw:
            rows = raw.begin(packet_parameters(link)).run(STEP, 0, steps)
        assert np.array_equal(rows[:, :2], values[1:]), number
        assert np.array_equal(rows[:, 2], state.age_s[1:]), number
        assert np.array_equal(rows[:, 3], state.sequence[1:]), number
        # what the queue refuses at a point is sent, and counted, by the step that begins there
        here = [np.count_nonzero(refused == k * STEP) for k in range(1, steps + 1)]
        assert np.array_equal(rows[:, 4], state.dropped[1:] - here), number


@pytest.mark.slow
def test_random_links_are_the_links_on_the_grid(channel: Path) -> None:
    check_random_links(channel, range(60))


@pytest.mark.slow
@pytest.mark.parametrize("part", share_of(range(8)))
def test_two_thousand_random_links_are_the_links_on_the_grid(channel: Path, part: int) -> None:
    check_random_links(channel, range(250 * part, 250 * (part + 1)))


@pytest.mark.parametrize("seed", sampled([2**31 - 1, 0, 1], 1))
@pytest.mark.parametrize("name", ["a", "downlink-2", "Funkstrecke \u00fc " + "x" * 120])
def test_draws_follow_name_and_seed(tmp_path: Path, name: str, seed: int) -> None:
    """Key of the stream: any length of name, any seed."""
    link = PacketLink(
        name, 30 * MS, delay_ns=90 * MS, loss=0.3, seed=seed,
        jitter=Jitter("normal", mean_ns=100 * MS, sigma_ns=80 * MS),
    )  # fmt: skip
    values, _ = expected(link, STEP, STEPS)
    with Channel(build(link, tmp_path, STEP)) as raw:
        rows = raw.begin().run(STEP, 0, STEPS)
    assert np.array_equal(rows[:, :2], values[1:])


def test_another_seed_is_another_run(channel: Path) -> None:
    link = PacketLink("uplink", 80 * MS, delay_ns=90 * MS, loss=0.3)
    found = []
    for seed in (3, 4):
        with Channel(channel) as raw:
            found.append(raw.begin(packet_parameters(replace(link, seed=seed))).run(STEP, 0, 50))
    assert not np.array_equal(found[0], found[1])


def test_steps_that_are_added_up_do_not_shift_a_message(channel: Path) -> None:
    """A master that says k * step with the rounding of k additions sends and delivers alike."""
    link = PacketLink("uplink", 100 * MS, delay_ns=100 * MS)
    steps = 20_000
    values, _ = expected(link, STEP, steps)
    sent = signal(np.arange(steps) * STEP)
    with Channel(channel) as raw:
        raw.begin(packet_parameters(link))
        t, rows = 0.0, []
        for k in range(steps):
            raw.put({"u[1]": sent[k, 0], "u[2]": sent[k, 1]})
            raw.step(t, 0.05)
            t += 0.05
            rows.append(raw.get("y[1]", "y[2]"))
    assert t != steps * 0.05
    assert np.array_equal(np.array(rows), values[1:])


def test_message_that_arrives_where_it_was_sent_is_one_step_late(channel: Path) -> None:
    """A link FMU has no direct feedthrough."""
    link = PacketLink("uplink", STEP)
    with Channel(channel) as raw:
        rows = raw.begin(packet_parameters(link)).run(STEP, 0, 20)
    assert np.array_equal(rows[:, :2], signal(np.arange(20) * STEP))
    assert np.allclose(rows[:, 2], 0.05)


@pytest.mark.parametrize("case", ["copies", "bursts", "slow"])
def test_saved_link_goes_on_as_it_would_have(channel: Path, case: str) -> None:
    """Messages on their way, the chain of bursts and the clock are in the state."""
    changed = {"sample_time_ns": 30 * MS, "order": "fifo"} | LINKS[case]
    parameters = packet_parameters(PacketLink("uplink", **changed))  # type: ignore[arg-type]
    with Channel(channel) as raw, Channel(channel, "twin", raw) as twin:
        raw.begin(parameters).run(STEP, 0, 37)
        data = raw.saved()
        after = raw.run(STEP, 37, 120)
        twin.begin(parameters).run(STEP, 0, 90)
        twin.resume(data)
        assert np.array_equal(twin.run(STEP, 37, 120), after)
        assert twin.saved() == raw.saved()


@pytest.mark.parametrize(
    "delay_ns", sampled([0, 50 * MS, 130 * MS, 20 * MS, 200 * MS, 60_000 * MS], 3)
)
def test_transport_link_fmu_reads_the_past(tmp_path: Path, delay_ns: int) -> None:
    """Interpolated as the project's own; a delay below the step is the step."""
    link = TransportLink("pipe", delay_ns)
    points = np.arange(STEPS + 1) * STEP
    index, weight = TransportLink("pipe", max(delay_ns, STEP)).rows(points)
    sent = signal(points)
    values = (1 - weight[:, None]) * sent[index] + weight[:, None] * np.append(sent, sent[-1:], 0)[
        index + 1
    ]
    with Channel(build(link, tmp_path, STEP)) as raw:
        rows = raw.begin().run(STEP, 0, 200)
        data = raw.saved()
        rest = raw.run(STEP, 200, STEPS)
        raw.resume(data)
        assert np.array_equal(raw.run(STEP, 200, STEPS), rest)
    found = np.concatenate([rows, rest])
    assert np.array_equal(found[:, :2], values[1:])
    assert np.allclose(found[:, 2], np.minimum(points[1:], max(delay_ns, STEP)) / 1e9)


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ({"data_rate": 10.5, "frame_size": 1.0}, "whole numbers"),
        ({"data_rate": 10.0}, "both or neither"),
        ({"data_rate": 1.0, "frame_size": 1e9}, "frame_size / data_rate"),
        ({"queue_limit": 3}, "queue_limit"),
        ({"delay": 0.2, "playout": 0.1}, "playout"),
        ({"jitter.kind": 3, "jitter.mean": 0.2, "jitter.max": 0.1}, "jitter.max"),
        ({"sample_time": 0.0}, "sample_time"),
        ({"loss.good": 1.5}, "loss.good"),
        ({"seed": -1}, "seed"),
        ({"order": 3}, "order"),
    ],
)
def test_parameters_without_a_meaning_are_refused(
    channel: Path, parameters: dict[str, float], expected: str
) -> None:
    with Channel(channel) as raw:
        with pytest.raises(Exception, match=r"failed with status 3"):
            raw.begin(parameters)
        assert expected in raw.messages


def test_messages_that_cannot_be_sent_in_time_discard_the_step(channel: Path) -> None:
    """The sum of their frames must fit into 64-bit nanoseconds, as for the project's own links."""
    slow = {"sample_time": 0.001, "data_rate": 1.0, "frame_size": 9e6}
    link = PacketLink("uplink", MS, data_rate=1, frame_size=9 * 10**6)
    with pytest.raises(InputError, match="longer to send"):
        deliver(link, 1000 * MS)
    with Channel(channel) as raw:
        raw.begin(slow)
        with pytest.raises(Exception, match=r"failed with status 2"):
            raw.run(1000 * MS, 0, 2)
        assert "data_rate is too small" in raw.messages


def test_far_too_many_messages_discard_the_step(channel: Path) -> None:
    with Channel(channel) as raw:
        raw.begin({"sample_time": 1e-9})
        with pytest.raises(Exception, match=r"failed with status 2"):
            raw.run(1000 * 1000 * MS, 0, 2)
        assert "sample_time is too short" in raw.messages


OVER_LINKS = """
title = "A loop over two links"
connect = ["plant.x -> controller.x : up", "controller.u -> plant.u : down"]
[run]
end = 1.0
step = 0.05
[components.plant]
fmu = "DelayedPlant"
[components.controller]
fmu = "PaperController"
[links]
"""


@pytest.mark.parametrize(
    ("up", "down", "warned"),
    [
        ('{ kind = "packet", sample_time = 0.05 }', "0.05", "'up': messages without delay"),
        ('{ kind = "packet", sample_time = 0.05, delay = 0.001 }', "0.02", "'down': its delay of"),
    ],
)
def test_export_warns_of_a_link_that_is_later_as_an_fmu(
    up: str, down: str, warned: str, native_fmus: Path, tmp_path: Path
) -> None:
    """Of messages without any delay, and of a delay below the step; of no other link."""
    text = f'{OVER_LINKS}up = {up}\ndown = {{ kind = "transport", delay = {down} }}\n'
    done = export(text, native_fmus, tmp_path, "fmu")
    assert [warned in warning for warning in done.warnings] == [True]


SHARED = 'kind = "packet", sample_time = 0.1, frame_size = 1, medium = "m", from = "a", to = "b"'
PROFILE = "delay = { times = [0.0, 1.0], delays = [0.1, 0.2] }"


@pytest.mark.parametrize(
    ("up", "words"),
    [
        (f'{{ kind = "packet", sample_time = 0.1, {PROFILE} }}', "its delay varies"),
        (f'{{ kind = "transport", {PROFILE} }}', "its delay varies"),
        ('{ kind = "packet", sample_time = 0.1, seed = 1099511627776 }', "its seed is above"),
        (
            '{ kind = "packet", sample_time = 0.1, recording = { sent = [0.0], replay = "loop" } }',
            "it replays a recording",
        ),
        (
            f"{{ {SHARED} }}",
            "shares the medium 'm' with others",
        ),
    ],
)
def test_link_that_no_fmu_can_be_stays_an_annotation_with_a_warning(
    up: str, words: str, native_fmus: Path, tmp_path: Path
) -> None:
    """What varies, what is replayed or shared, and a seed that no Integer of FMI holds."""
    bay = "[medium.m]\nnodes = { a = [0.0], b = [1.0] }\ndata_rate = 1000\n"
    text = f'{OVER_LINKS}down = {{ kind = "transport", delay = 0.1 }}\nup = {up}\n{bay}'
    done = export(text, native_fmus, tmp_path, "fmu")
    assert done.links == {"up": "annotation", "down": "FMU"}
    (warning,) = [one for one in done.warnings if "and no FMU" in one]
    assert warning.startswith("link 'up'")
    assert words in warning
