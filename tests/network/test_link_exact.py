"""Every answer of every delivery against an event-by-event model in integers and fractions."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any

import link_model
import numpy as np
import pytest
from shared import sampled, share_of

from cosim.master import compiled_delivery
from cosim.network import (
    REASONS,
    DelayProfile,
    DelaySignal,
    Delivery,
    GilbertElliott,
    Jitter,
    LossChain,
    LossWindow,
    PacketLink,
    Recording,
    TransportLink,
)


@dataclass
class Case:
    """A link, a run, its communication points, and the values of the signal behind its delay."""

    link: PacketLink
    end: int
    points: list[int]
    values: list[float]

    def delay(self, message: int, sent: int) -> int:
        declared, recording = self.link.delay, self.link.recording
        if recording is not None and recording.delay_ns is not None:
            late = int(recording.delay_ns[self.rows[message]])
            return 2**53 if late < 0 else late
        if declared is None:
            return self.link.delay_ns
        if isinstance(declared, DelaySignal):
            share = Fraction(declared.scale) * Fraction(self.values[message]) * 10**9
            return round(declared.offset_ns + share)
        return round(profile_at(declared, sent))

    @cached_property
    def rows(self) -> list[int]:
        return link_model.recorded_rows(self.link, len(self.values))

    def value(self, message: int) -> float | None:
        return self.values[message] if isinstance(self.link.delay, DelaySignal) else None


def profile_at(profile: DelayProfile, t: int) -> Fraction:
    known = list(zip(profile.times_ns.tolist(), profile.delays_ns.tolist(), strict=True))
    before = [sample for sample in known if sample[0] <= t]
    after = [sample for sample in known if sample[0] > t]
    if not before:
        return Fraction(known[0][1])
    if not after or profile.interpolation == "previous":
        return Fraction(before[-1][1])
    (t0, d0), (t1, d1) = before[-1], after[0]
    return d0 + Fraction((d1 - d0) * (t - t0), t1 - t0)


def draw_case(number: int) -> Case:
    """A short run of some link; small times make everything happen at once."""
    r = random.Random(number)  # noqa: S311 - cases, not secrets
    unit = r.choice([1, 1, 1, 1, 10**6, 2_000_000_011])
    sample, messages = r.randint(1, 15), r.randint(0, 20)
    offset = r.choice([0, 0, r.randint(0, 20)])
    end = (offset + sample * messages + r.randint(0, 10)) * unit
    link = PacketLink(
        r.choice(["uplink", "downlink"]),
        sample * unit,
        offset * unit,
        jitter=draw_jitter(r, unit),
        loss=draw_loss(r),
        order=r.choice(["newest-wins", "fifo", "as-arrived"]),
        on_loss=r.choice(["hold", "zero", 2.5]),
        seed=r.randrange(2**63),
        duplicate=r.choice([0.0, 0.0, 0.3, 0.7, 1.0]),
        **draw_rate(r, sample, unit),
        **draw_delay(r, unit, end),
    )
    points = draw_points(r, end, unit)
    values = [r.choice([0, r.randint(0, 40), r.uniform(0, 40)]) for _ in range(messages + 20)]
    link = replace(link, windows=draw_windows(r, end))
    # drawn last: the other keys of a case are what they were before there was a play-out
    if r.random() < 0.4:
        late = r.choice([0, r.randint(0, 10), r.randint(0, 60)]) * unit
        link = replace(link, playout_ns=max(1, link.least_transit_ns + late))
    if r.random() < 0.2:
        link = replace(link, loss=draw_chain(r))
    if r.random() < 0.3:
        link = with_recording(r, link, end)
    return Case(link, end, points, values)


def draw_jitter(r: random.Random, unit: int) -> Jitter:
    return r.choice(
        [
            Jitter(),
            Jitter("uniform", width_ns=r.randint(1, 40) * unit),
            Jitter("exponential", mean_ns=r.randint(1, 20) * unit),
            Jitter("exponential", mean_ns=5 * unit, max_ns=r.randint(5, 9) * unit),
            Jitter("normal", mean_ns=r.randint(0, 9) * unit, sigma_ns=r.randint(1, 20) * unit),
        ]
    )


def draw_loss(r: random.Random) -> float | GilbertElliott:
    p = [r.choice([0.0, 0.2, 0.5, 1.0, r.random()]) for _ in range(4)]
    return r.choice([0.0, 0.0, 0.2, 0.6, 1.0, GilbertElliott(*p), GilbertElliott(p[0], p[1])])


def draw_chain(r: random.Random) -> LossChain:
    k = r.randint(2, 4)
    rows = [[r.choice([0.0, r.random()]) for _ in range(k)] for _ in range(k)]
    for i, row in enumerate(rows):
        row[i] += not sum(row)
    moves = tuple(tuple(p / sum(row) for p in row) for row in rows)
    return LossChain(moves, tuple(r.choice([0.0, 0.5, 1.0, r.random()]) for _ in range(k)))


def with_recording(r: random.Random, link: PacketLink, end: int) -> PacketLink:
    """The link with a recording in place of its delay, jitter and loss."""
    every = link.sample_time_ns
    count = max(0, (end - link.offset_ns) // every + 1) + 60  # tests lengthen the run
    replay, rows = r.choice(["once", "loop", "blocks"]), r.choice([None, "message", "time"])
    size = r.randint(1, 12) if replay != "once" else count
    sent = [k * every + r.randint(0, max(0, (every - 1) // 2)) for k in range(size)]
    if rows == "time" and replay != "once":
        sent = sorted(r.randint(0, 4 * size * every) for _ in range(size))
    sent = [t - sent[0] for t in sorted(sent)]
    if rows == "time" and replay == "once":
        sent[-1] = max(sent[-1], count * every)
    lost = [r.random() < 0.4 for _ in sent]
    delays = [r.randint(0, 40) * every // 10 for _ in sent]
    if r.random() < 0.3 and size > 1:
        k = r.randrange(1, size)
        lost[k], delays[k] = False, -1
    ended = next((sent[k] for k in range(size) if delays[k] < 0), None)
    known = sum(min(delays[: k + 1]) >= 0 for k in range(size))
    if rows == "time":  # one for every sending, not for every row
        known = sum(ended is None or t < ended for t in range(0, sent[-1] + 1, every))
    recording = Recording(
        np.array(sent),
        np.array(lost),
        np.array(delays) if r.random() < 0.8 else None,
        replay=replay,
        block=r.randint(1, known) if replay == "blocks" else None,
        rows=rows,
    )
    less = replace(link, loss=0.0, playout_ns=0)
    if recording.delay_ns is None:
        return replace(less, recording=recording)
    recorded = replace(less, delay_ns=0, delay=None, jitter=Jitter(), recording=recording)
    late = recorded.least_transit_ns + r.randint(1, 4) * every
    return replace(recorded, playout_ns=late if link.playout_ns else 0)


def draw_windows(r: random.Random, end: int) -> tuple[LossWindow, ...]:
    edges = [sorted(r.randint(0, end) for _ in range(2)) for _ in range(r.choice([0, 0, 1, 2]))]
    return tuple(LossWindow(*edge, r.choice([0.0, 0.5, 1.0])) for edge in edges)


def draw_rate(r: random.Random, sample: int, unit: int) -> dict[str, Any]:
    if r.random() < 0.5:
        return {}
    frame = r.randint(1, 2 * sample + 3) * unit
    rate, size = r.choice([(10**9, frame), (3 * 10**8, max(1, 3 * frame // 10))])
    return {
        "data_rate": rate,
        "frame_size": size,
        "queue_limit": r.choice([None, 0, 1, r.randint(0, 5)]),
    }


def draw_delay(r: random.Random, unit: int, end: int) -> dict[str, Any]:
    kind = r.choice(["none", "constant", "constant", "profile", "profile", "signal", "signal"])
    if kind == "constant":
        return {"delay_ns": r.randint(0, 40) * unit}
    if kind == "profile":
        return {"delay": draw_profile(r, unit, end)}
    if kind == "signal":
        scale = r.choice([1e-9, 0.25e-9, -1e-9, 1 / 1500e6]) * unit
        offset = 40 * unit if scale < 0 else r.choice([0, r.randint(0, 9)]) * unit
        return {"delay": DelaySignal(scale, offset)}
    return {}


def draw_profile(r: random.Random, unit: int, end: int) -> DelayProfile:
    times = sorted({r.randint(-unit, end + unit) for _ in range(r.randint(1, 8))})
    delays = [r.randint(0, 40 * unit) for _ in times]
    return DelayProfile(np.array(times), np.array(delays), r.choice(["previous", "linear"]))


def draw_points(r: random.Random, end: int, unit: int) -> list[int]:
    if end == 0:
        return [0]
    step = r.choice([r.randint(1, 20) * unit, r.randint(1, 2 * end)])
    return [*range(0, end, step), end]


def step_of(points: list[int]) -> int:
    """The step of communication points."""
    return points[1] if len(points) > 1 else 1


def check_delivery(d: Delivery, end: int, model: link_model.Outcome, instants: list[int]) -> None:
    """Check every answer of a run that ended, and the state at the instants, by the model."""
    times, sent = d.changes(-1, end)
    changes = model.changes()
    assert times.tolist() == sorted(changes)
    assert sent.tolist() == [model.sent(model.at(t).used) for t in sorted(changes)]
    assert d.sendings(-1, end).tolist() == sorted({e.sent for e in model.entries.values()})
    check_arrivals(d, model)
    check_answers(d, model, instants)
    check_statistics(d.link, d.statistics(end), model)
    delays = [e.arrival - e.sent for e in model.entries.values() if e.fate == "delivered"]
    mean = sum(delays) / len(delays) / 1e9 if delays else None  # to the last bit
    assert d.statistics(end)["mean_delay_s"] == mean


def check_arrivals(s: Delivery, model: link_model.Outcome) -> None:
    """Check arrivals and drops against the model, in order."""
    expected = [
        (model.entries[label].arrival, model.entries[label].sent, label[0], fate)
        for label, fate in model.received
    ]
    arrivals = s.arrivals()
    fates = [REASONS[k] for k in arrivals.status.tolist()]
    columns = (
        arrivals.arrival_ns.tolist(),
        arrivals.sent_ns.tolist(),
        arrivals.sequence.tolist(),
        fates,
    )
    assert list(zip(*columns, strict=True)) == expected


def check_answers(s: Delivery, model: link_model.Outcome, instants: list[int]) -> None:
    notes = [model.at(t) for t in instants]
    used = s.sent_in_use(instants).tolist()
    assert used == [model.sent(n.used) for n in notes]
    if instants == sorted(instants):
        assert np.repeat(*s.runs_in_use(np.array(instants))).tolist() == used
    state = s.state(instants)
    assert state.sequence.tolist() == [model.sequence(n.used) for n in notes]
    assert state.delivered.tolist() == [n.delivered for n in notes]
    assert state.dropped.tolist() == [n.dropped for n in notes]
    ages = [Fraction(t - n.origin, 10**9) for t, n in zip(instants, notes, strict=True)]
    assert state.age_s.tolist() == [float(age) for age in ages]


def check_statistics(link: PacketLink, got: dict[str, Any], model: link_model.Outcome) -> None:
    expected = model.statistics()
    assert list(got) == list(expected)
    for key, value in expected.items():
        given = got[key]
        if isinstance(value, Fraction):
            assert given is not None
            assert abs(given - float(value)) <= 2 * math.ulp(float(value)), key
        elif given is None and key in ("duplicated", "discarded_copies"):
            assert link.duplicate == value == 0
        elif given is None and key == "late":
            assert link.playout_ns == value == 0
        elif given is None and key == "queue_full":
            assert link.queue_limit is None
            assert value == 0
        else:
            assert given == value, key
    counts = {key: value or 0 for key, value in got.items()}
    assert counts["sent"] + counts["duplicated"] == (
        counts["delivered"] + counts["dropped"] + counts["in_flight"]
    )
    assert counts["dropped"] == (
        counts["lost"]
        + counts["overtaken"]
        + counts["late"]
        + counts["queue_full"]
        + counts["discarded_copies"]
        + sum(counts.get(name.replace(" ", "_"), 0) for name in link_model.ON_MEDIUM)
    )


def grow(s: Delivery, case: Case, model: link_model.Outcome, r: random.Random) -> Iterator[int]:
    """Make a delivery known in blocks cut at random; yield the instant up to which it is."""
    known = -1
    while s.horizon_ns <= case.end:
        if not s.is_live:
            known += r.choice([0, 1, 1, r.randint(0, 1 + case.end // 20), 1 + case.end // 3])
            s.advance(known)
            known = min(known, case.end)
            assert s.horizon_ns == (known + 1 if known < case.end else 2**63 - 1)
            sent = [e.sent for (_, copy), e in model.entries.items() if not copy]
            assert s.message == sum(t <= known for t in sent)
            assert s.horizon_ns == (known + 1 if known < case.end else 2**63 - 1)
        else:
            for _ in range(r.choice([0, 1, 1, 3])):
                k = s.message
                if (k, 0) in model.entries:
                    assert s.horizon_ns == model.entries[k, 0].sent
                    assert s.resolve(k, case.values[k]) == model.entries[k, 0].arrival
            known = min(s.horizon_ns - 1, case.end)
            s.advance(known)
        yield known


def begin(case: Case, step: int | None, number: int) -> Delivery:
    """The delivery of a case at its beginning; every second one goes through the compiled loop."""
    return Delivery(case.link, case.end, step, compiled_delivery() if number % 2 else None)


def check_case(number: int) -> None:
    """One link in all its forms: known and live, instants as they are and on a grid."""
    case = draw_case(number)
    r = random.Random(-1 - number)  # noqa: S311 - cases, not secrets
    link, end = case.link, case.end
    for points in (None, case.points):
        raw = link_model.raw_draws(link, end, points)
        model = link_model.run(link, end, raw, case.delay, points)
        d = begin(case, None if points is None else step_of(points), number)
        for _ in grow(d, case, model, r):
            pass
        check_delivery(d, end, model, [*(r.randint(0, end) for _ in range(4)), 0, end])
        if number % 3 == 0:  # a run that ended early is as a shorter run
            stop = r.choice(points) if points else r.randint(0, end)
            until = None if points is None else [p for p in points if p <= stop]
            shorter = link_model.run(link, stop, raw, case.delay, until)
            check_statistics(link, d.statistics(stop), shorter)


def check_transport(number: int) -> None:
    """Index and weight of the interpolation, and the age, are those of exact fractions."""
    r = random.Random(number)  # noqa: S311 - cases, not secrets
    unit = r.choice([1, 1, 10**6, 2_000_000_011])
    end = r.randint(0, 200) * unit
    points = sorted({0, end, *(r.randint(0, end) for _ in range(r.randint(0, 30)))})
    delay: dict[str, Any] = {"delay_ns": r.randint(0, 120) * unit}
    if r.random() < 0.5:
        delay = {"delay": draw_profile(r, unit, end)}
    link = TransportLink("t", **delay)
    index, weight = link.rows(points)
    age = link.state(points).age_s
    for j, t in enumerate(points):
        late = link.delay_ns if link.delay is None else round(profile_at(link.delay, t))
        read = max(t - late, 0)
        i = max(k for k, p in enumerate(points) if p <= read)
        exact = Fraction(read - points[i], points[i + 1] - points[i]) if read > points[i] else 0
        assert index[j] == i <= j
        assert abs(Fraction(float(weight[j])) - exact) <= Fraction(1, 2**53)
        assert age[j] == float(Fraction(t - read, 10**9))


@pytest.mark.parametrize("part", sampled(range(6), 2))
@pytest.mark.parametrize("check", [check_case, check_transport])
def test_link_is_exact(check: Callable[[int], None], part: int) -> None:
    """1500 random links, nanosecond by nanosecond."""
    for number in range(250 * part, 250 * (part + 1)):
        check(number)


@pytest.mark.slow
@pytest.mark.parametrize("part", share_of(range(10)))
def test_link_is_exact_on_ten_thousand(part: int) -> None:
    """10 000 random links, nanosecond by nanosecond."""
    for number in range(1000 * part, 1000 * (part + 1)):
        check_case(number)
        check_transport(number)
