"""SI units of the variables, with their base-unit exponents as FMI asks for them."""

from __future__ import annotations

from types import MappingProxyType

UNITS = MappingProxyType(
    {
        "m": {"m": 1},
        "m/s": {"m": 1, "s": -1},
        "m/s2": {"m": 1, "s": -2},
        "rad": {"rad": 1},
        "rad/s": {"rad": 1, "s": -1},
        "rad/s2": {"rad": 1, "s": -2},
        "rad/m": {"rad": 1, "m": -1},
        "1/s": {"s": -1},
        "s": {"s": 1},
        "kg": {"kg": 1},
        "kg.m": {"kg": 1, "m": 1},
        "kg.m2": {"kg": 1, "m": 2},
        "kg/m3": {"kg": 1, "m": -3},
        "N": {"kg": 1, "m": 1, "s": -2},
        "N.m": {"kg": 1, "m": 2, "s": -2},
    }
)
"""Unit name -> exponents of kg, m, s, rad."""
