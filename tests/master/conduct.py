"""Runs a session in the child of a supervisor, without the events of a scenario."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from cosim.master import Session


@dataclass(frozen=True)
class ToItsEnd:
    """Runs a session to its end; nothing more is sent back."""

    result: ClassVar[None] = None

    def __call__(self, session: Session) -> None:
        """Run it."""
        session.go_on()
