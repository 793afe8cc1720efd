"""A key that does not exist: the one that is meant is named with the place where it may stand."""

from __future__ import annotations

from pathlib import Path

import pytest

from cosim.core import InputError
from cosim.scenario import load


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("seed = 3", "did you mean run.seed or links.NAME.seed or sensors.NAME.seed?"),
        ("[desing]\nsystem = 'auv'", "did you mean design?"),
        ("system = 'auv'", "did you mean design.system?"),
        ("[design]\nsystme = 'auv'", "did you mean system?"),
        ("[components.plant]\nfmu = 'x'\nparamters = {}", "did you mean parameters?"),
        ("[links.up]\nkind = 'packet'\ndealy = '1 s'", "did you mean delay?"),
        ("[links.up]\nkind = 'packet'\njitter = {kind = 'uniform', widht = 1}", "mean width?"),
    ],
)
def test_the_key_that_is_meant_is_named(text: str, hint: str, tmp_path: Path) -> None:
    """One of the same table, else the place of one elsewhere: never the word that was typed."""
    (tmp_path / "s.toml").write_text(f"title = 'x'\n{text}\n")
    with pytest.raises(InputError, match="there is no key") as refused:
        load(tmp_path / "s.toml")
    assert hint in str(refused.value.hint)
