"""The names that programs use: how many, and that each has an example that holds."""

from __future__ import annotations

import doctest
import importlib
import inspect
from pathlib import Path
from typing import Any

import pytest

import cosim
from docs_site.ring import RING

DOOR = [name for name in cosim.__all__ if name != "__version__"]
NAMES = [("cosim", name) for name in DOOR] + [
    (face, name) for face, names in RING.items() for name in names
]
LONG = {"Flight", "fly"}
"""Names whose example designs and flies a vehicle."""
ALIASES = {"Progress", "Seconds"}
"""Types without a class: they have no docstring to be read from Python."""


def test_the_ring_is_small_and_every_name_is_offered() -> None:
    assert len(NAMES) <= 120
    assert len({name for _, name in NAMES}) == len(NAMES)
    for face, name in NAMES:
        assert name in importlib.import_module(face).__all__, (face, name)


@pytest.mark.parametrize(
    ("face", "name"),
    [
        pytest.param(face, name, id=f"{face}.{name}", marks=[pytest.mark.slow] * (name in LONG))
        for face, name in NAMES
    ],
)
def test_the_example_of_a_name_holds(
    face: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As it stands in the docstring, in an empty folder."""
    if name in ALIASES:
        return
    itself: Any = getattr(importlib.import_module(face), name)
    text = inspect.getdoc(itself) or ""
    found = doctest.DocTestParser().get_doctest(text, {}, f"{face}.{name}", None, 0)
    assert found.examples, "no example"
    monkeypatch.chdir(tmp_path)
    words: list[str] = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    runner.run(found, out=words.append)
    assert runner.failures == 0, "".join(words)
