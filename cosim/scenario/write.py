"""A scenario as TOML again, without loss."""

from __future__ import annotations

import tomli_w

from cosim.scenario.schema import Scenario


def to_toml(scenario: Scenario) -> str:
    """The text that `parse` makes the same scenario of; what was left out stays left out."""
    data = scenario.model_dump(by_alias=True, exclude_unset=True, exclude_none=True)
    return tomli_w.dumps(data, multiline_strings=True)
