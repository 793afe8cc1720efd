"""The scenario of a flight over a recorded link: what replays it, and what the design is for."""

from __future__ import annotations

import pytest

from cosim.network import Recording
from cosim.vehicle import (
    FlightSettings,
    Mission,
    Sensor,
    planned_sensors,
    scenario_text,
)

SECOND = 10**9
SENSORS = (
    Sensor("dvl", ("nu.u",), 0.2, (0.01,), 0.3, "onboard"),
    Sensor("usbl", ("eta.x",), 1.0, (0.1,), 0.0, "link"),
)
STATES = ("eta.x", "nu.u")


def recorded(count: int, times: bool = True) -> Recording:  # noqa: FBT001, FBT002 - of a test
    """Messages every 2 s, 1.23 s under way at most."""
    delays = [1_000_000_000 + 230_000_000 * (k % 2) for k in range(count)] if times else None
    lost = [False] * count
    return Recording([2 * SECOND * k for k in range(count)], lost, delays)


def text_of(settings: FlightSettings) -> str:
    """The scenario of a flight with one set-point."""
    sensors = planned_sensors(SENSORS, STATES, settings)
    mission = Mission(set_points={1: 0.5}, errors={}, wave_height=0.0)
    return scenario_text("sledge", STATES, (), ("thrust.surge",), {}, sensors, mission, settings)


def test_links_replay_the_recording_and_what_is_on_board_does_not() -> None:
    """Set-points and what is measured over the link; for the greatest delay, in whole steps."""
    settings = FlightSettings.over(recorded(40), duration=60.0)
    assert settings.link == 1.25
    text = text_of(settings)
    replayed = 'recording = { file = "recording.csv", rows = "time" }'
    for name, has in (("usbl", True), ("set_points", True), ("onboard", False)):
        link = text.partition(f"[links.{name}]\n")[2].partition("\n\n")[0]
        assert (replayed in link) is has
        assert ("loss = " in link) is not has
        assert ("\ndelay = " in link) is not has
    (usbl,) = [s for s in planned_sensors(SENSORS, STATES, settings) if s.name == "usbl"]
    assert usbl.age == pytest.approx(1.25 + 1.0 * 4 + 2 * 0.05)


def test_a_flight_that_lasts_longer_begins_the_recording_again() -> None:
    """In a loop; as long a one is replayed once."""
    longer = FlightSettings.over(recorded(11), duration=60.0)
    assert 'rows = "time", replay = "loop"' in text_of(longer)
    assert "replay =" not in text_of(FlightSettings.over(recorded(31), duration=60.0))


def test_losses_alone_leave_the_delay_to_the_settings() -> None:
    """A log without times of arrival has no greatest delay."""
    settings = FlightSettings.over(recorded(40, times=False), duration=60.0)
    assert settings.link == 2.0
    text = text_of(settings)
    link = text.partition("[links.usbl]\n")[2].partition("\n\n")[0]
    assert "delay = 1.8" in link
    assert "jitter" in link
    assert "recording = " in link
    assert FlightSettings.over(recorded(40), link=3.0, duration=60.0).link == 3.0
