"""The certificate of an output feedback: plant, measurements, K, L, and the proof of their pair.

    {"kind": "output-feedback", "theorem": [...], "claim": {...}, "plant": {...},
     "measurements": [{"name", "C", "d", "any_age", "noise", "over"}], "estimated": [true, ...],
     "command_age": 0.0, "command_any_age": false, "K": [[...]], "L": [[[...]]],
     "pair": {"kind": "analysis" or "ages", "claim", "system", "variables", "K"}}

`plant` is a system as `system_json` writes it. A measurement whose age is known better has
`least_age`, `rate` or `sampled` beside the others. `L` has one matrix (n, k) per measurement, with
rows of zeros for states that are known (`estimated` false). The check makes the pair again from the
plant, the measurements, K and L (`observer_pair`), which must be the one that `pair` is about, and
then checks `pair`, an ordinary certificate.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cosim.core import Findings, InputError, Part, Values, format_value, valid
from cosim.hinf.certificate.certificate import check_certificate
from cosim.hinf.certificate.claim import Statement, document_of
from cosim.hinf.certificate.observer_pair import ObserverPair, pair_of
from cosim.hinf.certificate.system_json import differences, system_from_json, system_to_json
from cosim.hinf.certificate.system_parts import MeasurementPart, Rows, matrix_from_rows, number
from cosim.hinf.exact import exact_matrix
from cosim.models import Measurement

KIND = "output-feedback"


def output_feedback_to_json(pair: ObserverPair, certificate: dict[str, Any]) -> dict[str, Any]:
    """Return the certificate of a pair, whose analysis has this one, without checking it."""
    return document_of(
        output_feedback_claim(pair, certificate["claim"]),
        kind=KIND,
        plant=system_to_json(pair.plant),
        measurements=[measurement_to_json(x) for x in pair.measurements],
        estimated=pair.estimated.tolist(),
        command_age=pair.command_age,
        command_any_age=pair.command_any_age,
        K=pair.K.tolist(),
        L=[L_i.tolist() for L_i in pair.L],
        pair=dict(certificate),
    )


def output_feedback_claim(pair: ObserverPair, claim: dict[str, Any]) -> dict[str, Any]:
    """Return the claim of the certificate: that of the pair, and what the observer is."""
    observer = {
        "measurements": [x.name for x in pair.measurements],
        "noise": [list(x.noise) for x in pair.measurements],
        "known_states": [j + 1 for j in np.flatnonzero(~pair.estimated).tolist()],
        "command_age": pair.command_age,
        "command_any_age": pair.command_any_age,
    }
    return {**claim, "observer": observer}


def read_output_feedback(data: dict[str, Any]) -> Statement:
    """Read what the certificate of an output feedback states.

    Raises
    ------
    InputError : not a certificate.
    """
    pair, inner = pair_from_json(data), data["pair"]
    kind = inner.get("kind") if isinstance(inner, dict) else inner
    if kind not in ("analysis", "ages"):
        raise InputError(
            "not the proof of a pair",
            where="pair.kind",
            expected="analysis or ages",
            got=format_value(kind),
        )
    proof = check_certificate(inner)

    def failure() -> str | None:
        apart = pair_difference(pair, inner)
        if apart is not None:
            return f"the pair is not that of plant, measurements, K and L: {apart}"
        return proof.reason

    claim = output_feedback_claim(pair, proof.claim)
    return Statement(claim, failure, makers="pair and observer")


def pair_difference(pair: ObserverPair, inner: dict[str, Any]) -> str | None:
    """Return where the certificate of a pair is about another one; None where it is not."""
    system = system_from_json(inner["system"], "pair.system")
    apart = next(differences(system, pair.system), None)
    if apart is not None:
        return apart
    gain = matrix_from_rows(inner["K"], "pair.K")
    same = gain.shape == pair.gain.shape and exact_matrix(gain) == exact_matrix(pair.gain)
    return None if same else "K'"


def pair_from_json(data: dict[str, Any]) -> ObserverPair:
    """Read the pair of a certificate from its plant, measurements, K and L.

    Raises
    ------
    InputError : naming the key, what was expected and what was got.
    """
    plant = system_from_json(data["plant"], "plant")
    measurements = measurements_from_json(data["measurements"])
    estimated, any_command = data["estimated"], data["command_any_age"]
    if not isinstance(estimated, list) or not all(isinstance(x, bool) for x in estimated):
        raise InputError(
            "not which states are estimated",
            where="estimated",
            expected="a list of truth values, one per state",
            got=format_value(estimated),
        )
    if not isinstance(any_command, bool):
        raise InputError(
            "not a truth value",
            where="command_any_age",
            expected="true or false",
            got=format_value(any_command),
        )
    if not isinstance(data["L"], list):
        raise InputError(
            "not one injection per measurement",
            where="L",
            expected="a list of matrices",
            got=format_value(data["L"]),
        )
    pair = pair_of(
        plant,
        measurements,
        matrix_from_rows(data["K"], "K"),
        [matrix_from_rows(rows, f"L[{i}]") for i, rows in enumerate(data["L"])],
        command_age=number(data["command_age"], "command_age"),
        command_any_age=any_command,
        estimated=estimated,
    )
    for proved, given in zip(pair.measurements, measurements, strict=True):
        if proved.noise != given.noise:
            raise InputError(
                "products of this noise with L are no doubles",
                where=f"measurement {proved.name}: noise",
                expected=str(list(proved.noise)),
                got=str(list(given.noise)),
            )
    return pair


def measurement_to_json(x: Measurement) -> dict[str, Any]:
    """Return a measurement as JSON values; `measurements_from_json` gives the same back."""
    return {
        "name": x.name,
        "C": x.C.tolist(),
        "d": x.d,
        "any_age": x.any_age,
        **({"least_age": x.least_age} if x.least_age else {}),
        **({} if x.rate is None else {"rate": x.rate}),
        **({"sampled": True} if x.sampled else {}),
        "noise": list(x.noise),
        "over": x.over,
    }


class _MeasurementOfCertificate(MeasurementPart):
    """A measurement as `measurement_to_json` writes it."""

    C: Rows
    """y = C x + v, n columns."""


class _Measurements(Part):
    measurements: list[_MeasurementOfCertificate]


def measurements_from_json(data: Any) -> list[Measurement]:
    """Read the measurements of a certificate.

    Raises
    ------
    InputError : naming the key, what was expected and what was got.
    """
    findings = Findings(Values())
    parts = valid(_Measurements, {"measurements": data}, findings.origin).measurements
    measurements = []
    for i, part in enumerate(parts):
        with findings.at("measurements", i):
            measurements.append(part.measurement(part.C, any_age=part.any_age))
    return measurements


def measurement_differences(data: Any, wanted: Sequence[Measurement]) -> list[str]:
    """Return where the measurements of a certificate differ from others, as `differences` does.

    Noise that is proved may be greater than wanted.
    """
    proved = measurements_from_json(data)
    if [x.name for x in proved] != [x.name for x in wanted]:
        names = [", ".join(x.name for x in each) or "none" for each in (proved, wanted)]
        return [f"measurements: {names[0]} and {names[1]}"]
    differences = []
    for x, other in zip(proved, wanted, strict=True):
        one, two = ({**measurement_to_json(y), "over": ""} for y in (x, other))
        if all(a >= b for a, b in zip(x.noise, other.noise, strict=False)):
            one["noise"] = two["noise"]
        differences += [
            f"{x.name}, {key}: {one.get(key)} and {two.get(key)}"
            for key in sorted({*one, *two})
            if one.get(key) != two.get(key)
        ]
    return differences
