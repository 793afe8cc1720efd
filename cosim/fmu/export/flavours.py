"""The flavours in which FMUs are made; apart from what makes them, which takes long to load."""

from __future__ import annotations

from typing import Final, Literal

Flavour = Literal["native", "native-fmi3", "python"]
"""FMI 2.0 in C, FMI 3.0 in C, or FMI 2.0 as a Python slave."""

DEFAULT_FLAVOUR: Final = "native"
"""The flavour where none is named."""

FMI_VERSION = {"native": "2.0", "native-fmi3": "3.0", "python": "2.0"}
"""Flavour, which is the name of its folder -> version of FMI."""
