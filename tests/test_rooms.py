"""A file's name tells it from every other one of its package."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

import cosim

PACKAGE = Path(cosim.__file__).parent
ROOMS = sorted(path.name for path in PACKAGE.iterdir() if (path / "__init__.py").exists())


@pytest.mark.parametrize("room", ROOMS)
def test_no_two_files_of_a_package_have_one_name(room: str) -> None:
    """In whatever folder they are; the standalone checker names its by what they check."""
    of_room = (PACKAGE / room).rglob("*.py")
    files = [p for p in of_room if p.stem != "__init__" and p.parent.name != "standalone"]
    counts = Counter(path.stem for path in files)
    assert [stem for stem, times in counts.items() if times > 1] == []
