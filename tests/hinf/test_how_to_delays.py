"""docs/how-to/delay-systems.md: every block runs, in order, and prints what stands below it."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path
from typing import Any

import pytest

import cosim

PAGE = Path(cosim.__file__).parents[1] / "docs" / "how-to" / "delay-systems.md"
BLOCKS = re.findall(
    r"^```python\n(.*?)^```\n(?:\n```text\n(.*?)^```\n)?",
    PAGE.read_text("utf-8"),
    re.MULTILINE | re.DOTALL,
)


def same(found: str, expected: str) -> bool:
    """The same words, and numbers that agree to nine digits: rounding differs between machines."""
    number = r"[-+]?\d+\.\d+(?:e[-+]\d+)?"
    if re.sub(number, "#", found) != re.sub(number, "#", expected):
        return False
    pairs = zip(re.findall(number, found), re.findall(number, expected), strict=True)
    return all(float(a) == pytest.approx(float(b), rel=1e-9) for a, b in pairs)


def test_every_block_prints_what_stands_below_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One namespace, from the first block to the last; pictures go to an empty folder."""
    monkeypatch.chdir(tmp_path)
    assert len(BLOCKS) > 12
    names: dict[str, Any] = {}
    for code, expected in BLOCKS:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(code, str(PAGE), "exec"), names)  # noqa: S102 - the page is ours
        assert same(printed.getvalue(), expected), (code, printed.getvalue())
    assert {p.name for p in tmp_path.iterdir()} == {
        "step.png",
        "bode.png",
        "nyquist.png",
        "roots.png",
    }


def test_the_comparison_can_fail() -> None:
    """Other words, and another number."""
    assert same("a 1.25\n", "a 1.25\n")
    assert not same("a 1.25\n", "b 1.25\n")
    assert not same("a 1.25\n", "a 1.26\n")
