"""Refuse a result that says another thing than its certificate: another gain, system or bound.

A proof is about the doubles that it names. `dataclasses.replace(design, K=...)` would put another
gain beside it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Any

import numpy as np

from cosim.core import InputError
from cosim.hinf.certificate import (
    Guarantees,
    ObserverPair,
    StatePeaks,
    differences,
    gain_from_json,
    guarantees_from_json,
    pair_from_json,
    system_from_json,
)
from cosim.models import DelaySystem, Matrix


def require_proved_gain(
    certificate: Mapping[str, Any],
    system: DelaySystem,
    K: Matrix | None,
    stated: Mapping[str, Any],
    guarantees: Guarantees,
) -> None:
    """Refuse what a design or an analysis says, where its certificate says another thing.

    Parameters
    ----------
    K : (m, n); None for u = 0.
    stated : gamma, order, k1, k2, those of them that it says.

    Raises
    ------
    InputError : naming the first that differs.
    """
    _refuse(_gain_differences(certificate, system, K))
    _refuse(_bound_differences(certificate, stated))
    gain = np.zeros(system.B.T.shape) if K is None else K
    if guarantees != guarantees_from_json(dict(certificate), system, gain):
        _refuse(iter([f"{guarantees!r}, and others in the certificate"]))


def require_proved_pair(
    certificate: Mapping[str, Any],
    pair: ObserverPair,
    stated: Mapping[str, Any],
    peaks: StatePeaks | None,
) -> None:
    """Refuse what an output feedback says, where its certificate says another thing.

    stated : gamma and order.

    Raises
    ------
    InputError : naming the first that differs.
    """
    inner = certificate["pair"]
    _refuse(_gain_differences(inner, pair.system, pair.gain))
    if pair != pair_from_json(dict(certificate)):
        _refuse(iter(["a pair of another plant, measurement, K or L"]))
    _refuse(_bound_differences(inner, stated))
    if peaks != guarantees_from_json(inner, pair.system, pair.gain).state_peaks:
        _refuse(iter(["other peaks of the state than in the certificate"]))


def _gain_differences(
    certificate: Mapping[str, Any], system: DelaySystem, K: Matrix | None
) -> Iterator[str]:
    proved = system_from_json(certificate["system"])
    apart = [f"system: {one}" for one in differences(system, proved)]
    if apart:
        yield apart[0]
        return
    gain = gain_from_json(certificate["K"], proved)
    stated = np.zeros_like(gain) if K is None else K
    if stated.shape != gain.shape:
        yield f"K: shape {stated.shape} and {gain.shape}"
        return
    for i, j in np.argwhere(stated != gain).tolist():
        yield f"K[{i + 1},{j + 1}]: {float(stated[i, j])!r} and {float(gain[i, j])!r}"


def _bound_differences(certificate: Mapping[str, Any], stated: Mapping[str, Any]) -> Iterator[str]:
    for name, number in stated.items():
        proved = certificate["variables"].get(name)
        if isinstance(proved, str):
            proved = float(Fraction(proved))
        elif isinstance(proved, list):
            proved = tuple(float(Fraction(x)) for x in proved)
        if number != proved:
            yield f"{name}: {number!r} and {proved!r}"


def _refuse(differences: Iterator[str]) -> None:
    for first in differences:
        raise InputError(
            "what is said is not what is proved",
            where="the certificate of this result",
            expected="the system, the gain and the bound of the proof",
            got=first,
            hint="analyse(system, K) proves another gain; design_from_json reads a design again",
        )
