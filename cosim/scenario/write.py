"""A scenario as TOML again, without loss."""

from __future__ import annotations

from typing import Any

import tomli_w

from cosim.scenario.schema import Scenario


def to_data(scenario: Scenario) -> dict[str, Any]:
    """The tables of a scenario; what was left out stays left out."""
    return scenario.model_dump(by_alias=True, exclude_unset=True, exclude_none=True)


def to_toml(scenario: Scenario) -> str:
    """The text that `parse` makes the same scenario of."""
    return tomli_w.dumps(to_data(scenario), multiline_strings="\r" not in scenario.description)
