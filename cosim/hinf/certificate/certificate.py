"""The exact certificate: a proof, in rational arithmetic, of what the deployed K guarantees.

A solver's optimum lies on the boundary and proves nothing. Here the doubles of a file are taken as
the rationals that they are, and what its kind asks for is shown to hold. The claim says
`"inputs": "doubles"`.

As JSON a certificate contains everything that the proof needs: the claim, the theorem in words, the
system, and the parts of its kind (`KINDS`); where more is proved than gamma, `guarantees`
(`cosim.hinf.certificate.guarantees`). Other keys are notes: `CertificateCheck.not_read`.
"""

from __future__ import annotations

import hashlib
import importlib
import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from cosim.core import DESIGN_FILE, SCHEMA, InputError, format_value, unreadable
from cosim.hinf.certificate.claim import CertificateCheck, Statement
from cosim.hinf.certificate.document import Certificate
from cosim.hinf.certificate.guarantees import KEY, guarantees_from_json
from cosim.hinf.certificate.system_json import known_keys


class _Kind(NamedTuple):
    """What is needed beside the claim, and the function of a module that reads it."""

    needs: tuple[str, ...]
    module: str
    read: str


_LOOP = ("system", "variables", "K")
_OBSERVER = ("command_age", "command_any_age", "K", "L", "pair")
KINDS: dict[str | None, _Kind] = {
    None: _Kind(_LOOP, "theorem_2_certificate", "read_theorem_2"),
    "analysis": _Kind(_LOOP, "ages_certificate", "read_loop"),
    "ages": _Kind(_LOOP, "ages_certificate", "read_loop"),
    "refutation": _Kind(
        ("system", "at", "multipliers"), "refutation_certificate", "read_refutation"
    ),
    "gamma floor": _Kind(("system", "gamma", "w"), "refutation_certificate", "read_gamma_floor"),
    "norm": _Kind(("system", "K", "gamma", "end", "steps"), "norm_certificate", "read_norm"),
    "output-feedback": _Kind(
        ("plant", "measurements", "estimated", *_OBSERVER),
        "output_feedback_certificate",
        "read_output_feedback",
    ),
}
"""The kinds of certificates; a gain that Theorem 2 proves has none. Loaded for one of its kind."""

_NOTES = (SCHEMA, "figures", "made_for")  # of a saved design, no part of its certificate
_LABELS = ("name", "integrals")  # of a system: what it is called, who keeps its last states
_WAYS = ("over",)  # of a measurement


def check_certificate(data: Any) -> CertificateCheck:
    """Check a certificate from its JSON alone, with rational arithmetic and no solver.

        >>> import json
        >>> from cosim import DelaySystem, analyse, check_certificate
        >>> path = analyse(DelaySystem(A=[[-1]], C=[[1]], D=[[1]])).save("proof.json")
        >>> data = json.loads(path.read_text())
        >>> check_certificate(data).valid
        True
        >>> data["claim"]["gamma"] = "1/2"
        >>> check_certificate(data).reason
        'the claim is not the one that system and variables make'

    Raises
    ------
    InputError : not a certificate: a missing key, a wrong shape, a text that is no number.
        (Where the claim is not proved, no error: `valid` is False.)
    """
    if not isinstance(data, dict):
        hint = "a file that cosim design --save wrote"
        got = type(data).__name__
        raise InputError("not a certificate", expected="an object of keys", got=got, hint=hint)
    kind = _kind_of(data)
    needed = (*(["kind"] if "kind" in data else []), "claim", *kind.needs)
    known_keys(data, "certificate", tuple(data), required=needed)
    read: Callable[[dict[str, Any]], Statement] = getattr(
        importlib.import_module(f"cosim.hinf.certificate.{kind.module}"), kind.read
    )
    statement = _with_guarantees(read(data), data)
    return replace(statement.judged(data), not_read=tuple(_not_read(data)))


def _kind_of(data: dict[str, Any]) -> _Kind:
    kind = data.get("kind")
    known = KINDS.get(kind) if isinstance(kind, str) or "kind" not in data else None
    if known is None:
        names = ", ".join(f'"{name}"' for name in KINDS if name is not None)
        raise InputError(
            "not a kind of certificate",
            where="certificate.kind",
            expected=f"{names}, or no kind at all (Theorem 2)",
            got=format_value(kind),
        )
    return known


def _with_guarantees(statement: Statement, data: dict[str, Any]) -> Statement:
    """Return a statement about a loop with the guarantees that the file has beside it."""
    if statement.loop is None:
        return statement
    system, gain = statement.loop
    guarantees = guarantees_from_json(data, system, gain)
    return replace(
        statement,
        claim=statement.claim | guarantees.claim(),
        failure=lambda: statement.failure() or guarantees.failure(system, gain),
    )


def _not_read(data: dict[str, Any]) -> Iterator[str]:
    """Yield the keys on which a check does not depend, such as `system.name`.

    Nobody is to take them for proved. The checkers refuse unknown keys below these.
    """
    kind = _kind_of(data)
    read = {"kind", "claim", "theorem", *kind.needs, *([KEY] if kind.needs is _LOOP else [])}
    yield from (key for key in data if key not in read)
    for of in ("system", "plant"):
        yield from (f"{of}.{key}" for key in _LABELS if key in data.get(of, ()))
    for i, measurement in enumerate(data.get("measurements", ())):
        yield from (f"measurements[{i}].{key}" for key in _WAYS if key in measurement)
    if "pair" in data:
        yield from (f"pair.{key}" for key in _not_read(data["pair"]))


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
        hint = "a file that cosim design --save wrote"
        raise InputError("not JSON", where=place, got=error.msg, hint=hint) from error
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
