"""What all tests of links have in common."""

from __future__ import annotations

import pytest

from cosim.network import delivery


@pytest.fixture(autouse=True)
def _few(monkeypatch: pytest.MonkeyPatch) -> None:
    """The compiled loop has every block of messages, also one that Python had sooner."""
    monkeypatch.setattr(delivery, "FEW", 1)
