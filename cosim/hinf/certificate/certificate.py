"""The exact certificate: a proof, in rational arithmetic, of what the deployed K guarantees.

A solver's optimum lies on the boundary and proves nothing. Here the doubles of the solver's
variables, of K and of the system are taken as the dyadic rationals that they are, Y := K X
exactly, and the corrected LMI of Theorem 2 is shown to hold (`proof`). The claim says
`"inputs": "doubles"`.

As JSON a certificate contains everything that the proof needs:

    {"claim": {...}, "system": {...}, "variables": {"X": [["p/q", ...]], ...}, "K": [[...]]}

and, where more is proved than gamma, `guarantees` (`cosim.hinf.certificate.guarantees`).
"""

from __future__ import annotations

import hashlib
import importlib
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cosim.core import DESIGN_FILE, SCHEMA, InputError, format_value, unreadable
from cosim.hinf.certificate.document import Certificate
from cosim.hinf.certificate.guarantees import Guarantees, guarantees_from_json
from cosim.hinf.certificate.not_read import not_read
from cosim.hinf.certificate.proof import (
    CertificateCheck,
    Variables,
    claim_of,
    exact_variables,
    proved,
)
from cosim.hinf.certificate.system_json import known_keys, system_from_json, system_to_json
from cosim.hinf.certificate.system_parts import matrix_from_rows
from cosim.hinf.certificate.theorem import theorem_of
from cosim.hinf.certificate.variables_json import variables_from_json, variables_to_json
from cosim.hinf.exact import exact_matrix, matrix_from_text, matrix_to_text
from cosim.hinf.theorems import ExactVariables
from cosim.models import DelaySystem, Matrix

_OTHERS = {
    "analysis": ("analysis_certificate", "check_analysis"),
    "ages": ("ages_certificate", "check_ages"),
    "refutation": ("refutation_certificate", "check_refutation"),
    "gamma floor": ("refutation_certificate", "check_gamma_floor"),
    "norm": ("norm_certificate", "check_norm"),
    "output-feedback": ("output_feedback_certificate", "check_output_feedback"),
}
"""Module and function that checks a kind of certificate, loaded for one that is of this kind; a
gain proved by Theorem 2 has no kind."""

_KEYS = ("claim", "system", "variables", "K")
_NOTES = (SCHEMA, "figures", "made_for")  # of a saved design, no part of its certificate
_VARIABLES = ("X", "Y", "Q", "R", "eps", "k1", "k2", "gamma")


def certify(system: DelaySystem, K: ArrayLike, variables: Variables) -> CertificateCheck:
    """Prove the LMI for u = K x(t-d_f) with the doubles of K, or return why it is not proved.

    The matrices of `variables` are symmetrised first, exactly.

    Parameters
    ----------
    system : the system, its doubles taken exactly.
    K : (m, n) the gain that is deployed.
    variables : a solution of the LMI, as floats.

    Raises
    ------
    InputError : if shapes do not fit or a number is not finite; never because an inequality fails.
    """
    gain = _gain(K, system)
    return proved(system, gain, exact_variables(system, variables))


def certificate_to_json(
    system: DelaySystem,
    K: ArrayLike,
    variables: Variables,
    guarantees: Guarantees | None = None,
) -> dict[str, Any]:
    """Return the certificate as JSON values for `check_certificate`, without checking it.

    Raises
    ------
    InputError : if shapes do not fit or a number is not finite.
    """
    gain = _gain(K, system)
    v = exact_variables(system, variables)
    more = guarantees or Guarantees()
    texts, Y = variables_to_json(v), matrix_to_text(exact_matrix(gain) * v.X)
    claim = claim_of(system, v.gamma) | more.claim()
    return {
        "theorem": theorem_of(claim),
        "claim": claim,
        "system": system_to_json(system),
        "variables": {"X": texts.pop("X"), "Y": Y, **texts},
        "K": gain.tolist(),
        **more.to_json(),
    }


def check_certificate(data: Any) -> CertificateCheck:
    """Check a certificate from its JSON alone, with rational arithmetic and no solver.

    With `"kind": "analysis"` it is one of `analysis_certificate`, with "ages" one of
    `ages_certificate`, with "norm" one of `norm_certificate`, with "refutation" or "gamma
    floor" one of `refutation_certificate`, with "output-feedback" one of
    `output_feedback_certificate`, without a kind one of Theorem 2. Other top-level
    keys than those of the module's docstring are notes: `CertificateCheck.not_read` lists them.

    Raises
    ------
    InputError : not a certificate: a missing key, a wrong shape, a text that is no number.
        (Where the claim is not proved, no error: `valid` is False.)
    """
    if not isinstance(data, dict):
        raise InputError("not a certificate", expected="an object of keys", got=type(data).__name__)
    if "kind" in data:
        kind = data["kind"]
        named = _OTHERS.get(kind) if isinstance(kind, str) else None
        if named is None:
            known = ", ".join(f'"{name}"' for name in _OTHERS)
            raise InputError(
                "not a kind of certificate",
                where="certificate.kind",
                expected=f"{known}, or no kind at all (Theorem 2)",
                got=format_value(kind),
            )
        module, name = named
        check: Callable[[dict[str, Any]], CertificateCheck] = getattr(
            importlib.import_module(f"cosim.hinf.certificate.{module}"), name
        )
    else:
        check = _check_theorem_2
    return replace(check(data), not_read=not_read(data))


def _check_theorem_2(data: dict[str, Any]) -> CertificateCheck:
    """Check a certificate without a kind."""
    own = {key: data[key] for key in _KEYS if key in data}
    known_keys(own, "certificate", _KEYS, required=_KEYS)
    system = system_from_json(data["system"])
    n, m = system.B.shape
    rows = matrix_from_rows(data["K"], "K")
    gain = _gain(rows if m or rows.size else np.zeros((0, n)), system)
    v, Y = _variables_from_json(system, data["variables"])
    more = guarantees_from_json(data, system)

    def reason() -> str | None:
        if exact_matrix(gain) * v.X != Y:
            return "Y is not K X"
        return proved(system, gain, v).reason

    claim = claim_of(system, v.gamma)
    return more.judged(data, (system, gain), claim, v.matrices(), reason)


def read_certificate(path: str | Path) -> Any:
    """Read the data of a certificate file, for `check_certificate`.

    Raises
    ------
    InputError : if the file cannot be read or is no JSON, with the line.
    """
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise unreadable(Path(path), error, what="cannot be read") from error
    return certificate_from_bytes(content, str(path))


def certificate_from_bytes(content: bytes, where: str) -> Any:
    """Read the data of a certificate from bytes; messages name `where`.

    Raises
    ------
    InputError : if it is no JSON, with the line; if it has a newer schema version.
    """
    try:
        data = json.loads(content.decode("utf-8"))
    except json.JSONDecodeError as error:
        place = f"{where}, line {error.lineno}, column {error.colno}"
        raise InputError("not JSON", where=place, got=error.msg) from error
    except (ValueError, RecursionError) as error:
        raise InputError("not a certificate in JSON", where=where, got=str(error)) from error
    if not isinstance(data, dict):
        return data
    return Certificate(DESIGN_FILE.current(data, where))


def certificate_bytes(data: dict[str, Any]) -> bytes:
    """Return a certificate, or that of a saved design, as JSON in one form: sorted, no spaces.

    Raises
    ------
    ValueError : a NaN or an infinity, which JSON does not have.
    """
    kept = {key: value for key, value in data.items() if key not in _NOTES}
    text = json.dumps(kept, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return text.encode() + b"\n"


def certificate_hash(data: dict[str, Any]) -> str:
    """Return the SHA-256 of `certificate_bytes`, 64 hexadecimal digits."""
    return hashlib.sha256(certificate_bytes(data)).hexdigest()


def _gain(K: ArrayLike, system: DelaySystem) -> Matrix:
    gain = np.asarray(K, dtype=np.float64)
    n, m = system.B.shape
    if gain.shape != (m, n):
        raise InputError("wrong shape", where="K", expected=str((m, n)), got=str(gain.shape))
    if not np.isfinite(gain).all():
        raise InputError("not finite", where="K", expected="finite numbers", got=str(gain.tolist()))
    return gain


def _variables_from_json(system: DelaySystem, data: Any) -> tuple[ExactVariables, Any]:
    """Read the variables and Y."""
    known_keys(data, "variables", _VARIABLES, required=_VARIABLES)
    others = {key: value for key, value in data.items() if key != "Y"}
    v = variables_from_json(others, system, "variables", gain=system.has_performance)
    n, m = system.B.shape
    return v, matrix_from_text(data["Y"], "variables.Y", m, n)
