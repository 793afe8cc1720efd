"""A little of the trouble that `make chaos` makes, the same each time."""

from __future__ import annotations

from pathlib import Path

import pytest
from chaos.doors import DOORS, make_stock
from chaos.trials import Trial, attempt, trial_of
from chaos.troubles import TROUBLES, doors_of
from shared import made_once

RUN_S = 2.0


def stock() -> Path:
    """What the doors read, made once per session."""
    return made_once("chaos", make_stock)


@pytest.mark.parametrize("number", range(0, 6, 2))
def test_a_command_is_interrupted(number: int) -> None:
    """At an instant between its first line and its last."""
    assert attempt(trial_of(1, number), stock(), RUN_S).departures == ()


@pytest.mark.slow
@pytest.mark.parametrize("trouble", TROUBLES)
def test_each_trouble_ends_as_it_must(trouble: str) -> None:
    """Through a door that it comes to."""
    doors = doors_of(trouble)
    door = doors[sum(map(ord, trouble)) % len(doors)]
    assert attempt(Trial(1, 0, trouble, door), stock(), RUN_S).departures == ()


@pytest.mark.slow
def test_an_fmu_that_hangs_when_it_is_freed_ends_at_its_limit() -> None:
    """In a study too, whose workers are freed of it one by one."""
    assert attempt(trial_of(52818025, 9), stock(), RUN_S).departures == ()


def test_closed_streams_are_no_fault_of_a_component() -> None:
    """A session without standard output and errors: what a worker is given has other numbers."""
    assert attempt(trial_of(20261128, 223), stock(), RUN_S).departures == ()


def test_every_trouble_has_a_door() -> None:
    assert all(set(doors_of(name)) <= set(DOORS) and doors_of(name) for name in TROUBLES)
