"""Solvers that fail, as a test says."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import clarabel
import pytest


def break_clarabel(monkeypatch: pytest.MonkeyPatch, status: str) -> None:
    """Clarabel stops at the first point, zero, and says so with this status."""

    class Failing:
        def __init__(self, _P: Any, q: Any, _A: Any, b: Any, *_: Any) -> None:
            at = {"x": 0 * q, "z": 0 * b, "obj_val": 0.0, "solve_time": 0.0, "iterations": 0}
            self._at = SimpleNamespace(**at, status=status)

        def solve(self) -> Any:
            return self._at

    monkeypatch.setattr(clarabel, "DefaultSolver", Failing)


def break_all(monkeypatch: pytest.MonkeyPatch, status: str) -> None:
    """So does Clarabel, and the dense solver makes no step."""
    monkeypatch.setattr("cosim.hinf.lmi.interior_point._moved", lambda *_: None)
    break_clarabel(monkeypatch, status)
