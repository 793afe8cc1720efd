"""How old messages may be: against published limits, designs of its own, and counted events."""

from __future__ import annotations

import itertools
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from cosim.core import InputError, NotAchievableError
from cosim.hinf import Delay, DelaySystem, MessageAges, message_ages, spectral_abscissa
from cosim.hinf.delay_lti import close
from cosim.hinf.problem import Modem

NETWORKED = DelaySystem(A=[[0, 1], [0, -0.1]], B=[[0], [0.1]], name="networked loop")
GAIN = [[-3.75, -11.5]]


@pytest.fixture(scope="module")
def networked() -> MessageAges:
    """The networked loop of the literature with its gain."""
    return message_ages(NETWORKED, gain=GAIN, ages=[0.5, 1.0, 1.5])


def test_limits_are_those_of_the_literature_and_in_order(networked: MessageAges) -> None:
    """Any age 1.04 and sampled 1.6 are published; 1.1672 is exact."""
    any_age, sampled, constant, exact = networked.limits
    assert [x.assumption for x in networked.limits] == ["any", "sampled", "constant", "exact"]
    assert 1.04 < any_age.age < constant.age < exact.age
    assert 1.6 < sampled.age < 2 * exact.age
    at = close(replace(NETWORKED, delays=[Delay(exact.age, np.zeros((2, 2)), feedback=True)]), GAIN)
    assert abs(spectral_abscissa(at)) < 1e-9


def test_an_age_without_proof_says_why(networked: MessageAges) -> None:
    """At 1.5 s the loop is unstable, so that nothing can be proved."""
    assert [row.certified for row in networked.rows] == [True, True, False]
    last = networked.rows[-1]
    assert (last.stable, last.gamma, last.exact_norm) == (False, None, None)
    assert "not stable" in str(last.reason)
    assert networked.age == 1.0, "the middle one of those that are proved"


def test_each_age_has_its_own_gain_and_exact_figures() -> None:
    """Older messages cost more; norm and control are those of the frequency response."""
    system = DelaySystem(A=[[0.5]], B=[[1.0]], C=[[1.0]], D=[[1.0], [0.0]], D2=[[0.0], [0.3]])
    found = message_ages(system, ages=[0.4, 0.1])
    young, old = found.rows
    assert (young.age, old.age) == (0.1, 0.4)
    assert young.gamma < old.gamma
    assert young.gamma >= young.exact_norm
    for row in found.rows:
        k = row.K.item()
        omega = np.linspace(0.0, 60.0, 60_001)
        to_x = 1 / (1j * omega - 0.5 - k * np.exp(-1j * omega * row.age))
        assert np.abs(to_x * k).max() == pytest.approx(row.control, rel=1e-6)
        z = np.hypot(np.abs(to_x), 0.3 * np.abs(to_x * k))
        assert z.max() == pytest.approx(row.exact_norm, rel=1e-6)


@pytest.mark.slow
def test_a_gamma_is_met_or_missed() -> None:
    """And with it the limits are shorter than for stability."""
    system = DelaySystem(
        A=[[0.5]], B=[[1.0]], C=[[1.0]], D=[[1.0], [0.0]], D2=[[0.0], [0.3]],
        delays=[Delay(0.2, [[0.0]], feedback=True, any_age=True)],
    )  # fmt: skip
    loose = message_ages(system, ages=[0.2], gain=[[-2.0]])
    tight = message_ages(system, ages=[0.2, 0.5], gain=[[-2.0]], gamma=1.5)
    assert [row.certified for row in tight.rows] == [True, False]
    for one, other in zip(tight.limits[:3], loose.limits[:3], strict=True):
        assert one.age < other.age
    with pytest.raises(NotAchievableError, match="no gain is proved at any of these ages"):
        message_ages(system, ages=[0.2], gain=[[-2.0]], gamma=0.1)


@pytest.mark.parametrize("ages", [[], [0.0], [-1.0], [float("nan")], [float("inf")]])
def test_no_age_is_refused(ages: list[float]) -> None:
    """Before anything is computed."""
    with pytest.raises(InputError, match="age"):
        message_ages(NETWORKED, gain=GAIN, ages=ages)


MODEM = Modem(bit_rate=5000, packet_bytes=64, range_m=600, slot_s=0.5, loss=0.05, other_s=0.25)


def test_ages_of_a_modem_event_by_event() -> None:
    """Every pattern of losses with no more in a row than are borne; the oldest one counts."""
    sending = Fraction(64 * 8, 5000)
    late = sending + Fraction(600, 1500) + Fraction(1, 4)
    k, slot = MODEM.losses_borne, Fraction(1, 2)
    oldest, freshest = Fraction(0), Fraction(10**6)
    for lost in itertools.product((False, True), repeat=k + 3):
        if any(all(lost[i : i + k + 1]) for i in range(3)):
            continue
        sent = [i * slot for i, gone in enumerate((False, *lost, False)) if not gone]
        for before, after in itertools.pairwise(sent):
            oldest = max(oldest, after + late - before)
            freshest = min(freshest, before + late - before)
    assert MODEM.least == pytest.approx(float(freshest), rel=1e-15)
    assert MODEM.greatest == pytest.approx(float(oldest), rel=1e-15)


def test_losses_borne_are_exceeded_once_an_hour_at_most() -> None:
    """Counted over a million slots; one fewer would be exceeded more often."""
    rng = np.random.default_rng(3)
    lost = rng.random(2_000_000) < MODEM.loss
    hours = lost.size * 0.5 / 3600

    def longer_runs(k: int) -> float:
        ended = np.flatnonzero(~lost)
        return float((np.diff(ended) - 1 > k).sum()) / hours

    k = MODEM.losses_borne
    assert longer_runs(k) == pytest.approx(MODEM.longer_runs_per_hour, rel=0.2)
    assert MODEM.longer_runs_per_hour <= 1.0 < longer_runs(k - 1)


def test_arithmetic_adds_up() -> None:
    """What is shown are the numbers that are used."""
    rows = {what: seconds for what, seconds, _ in MODEM.arithmetic()}
    assert rows["least age"] == pytest.approx(rows["sending"] + rows["travel"] + rows["other"])
    assert rows["greatest age"] == pytest.approx(rows["least age"] + rows["losses"])
    assert MODEM.slot == 0.5
    assert replace(MODEM, slot_s=None).slot == MODEM.sending
    assert replace(MODEM, loss=0.0).losses_borne == 0


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"bit_rate": 0.0}, "bit_rate"),
        ({"packet_bytes": -1}, "packet_bytes"),
        ({"range_m": float("nan")}, "range_m"),
        ({"slot_s": 0.1}, "a message does not fit into its slot"),
        ({"loss": 1.0}, "loss"),
        ({"loss": 0.999}, "too many losses to bear"),
        ({"losses": -1}, "losses"),
        ({"other_s": -0.1}, "other_s"),
        ({"sound_speed": 0.0}, "sound_speed"),
    ],
)
def test_nonsense_about_a_modem_is_refused(change: dict[str, float], word: str) -> None:
    """Naming what."""
    with pytest.raises(InputError, match=word):
        _ = replace(MODEM, **change).greatest
