"""Builds FMUs of hostile.c, of FMI 2.0 or 3.0, and the parameters that make them misbehave."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from compiled import compile_fmu

_SOURCE = Path(__file__).with_name("hostile.c")


@cache
def enumeration(source: Path, comment: str) -> tuple[str, ...]:
    """The names of an enumeration of a C file, such as stack-overflow for STACK_OVERFLOW."""
    text = source.read_text("utf-8")
    body = re.findall(rf"^enum {{ /\* {comment} \*/(.*?)}};", text, re.DOTALL | re.MULTILINE)[0]
    names = re.findall(r"[A-Z_0-9]+", re.sub(r"/\*.*?\*/", "", body))
    return tuple(name.lower().replace("_", "-") for name in names)


CALLS = enumeration(_SOURCE, "calls")
"""The functions of FMI in which a fault may happen; `load` is before any of them."""
FAULTS = enumeration(_SOURCE, "faults")
"""What may happen there; the first one is nothing."""

_REALS = (
    *(("at", 0.0), ("beyond", -1.0), ("seconds", 0.05), ("megabytes", 1024.0)),
    *(("decay", 0.0), ("x0", 0.0)),
)
_FIRST_REAL, _FIRST_INTEGER = 2, 8


class Counts(NamedTuple):
    """What was done after the initialisation, and how often it misbehaved.

    It survives the process.
    """

    begun: int
    done: int
    got: int
    set: int
    faults: int


def hostile_fmu(
    folder: Path,
    version: str,
    name: str = "hostile",
    *,
    fault: str = "nothing",
    call: str = "step",
    at: float = 0.0,
    nth: int = 1,
    counts: Path | None = None,
) -> Path:
    """Make name.fmu; FMUs of two names are two FMUs.

    Parameters
    ----------
    fault, call, at, nth : as `misbehaviour`; in force before any parameter is set.
    counts : the file for `counts_in`; made here.
    """
    settings = f"{FAULTS.index(fault)} {CALLS.index(call)} {at!r} {nth} {counts or '-'}\n"
    if counts is not None:
        counts.write_bytes(bytes(8 * len(Counts._fields)))
    integers = (FAULTS.index(fault), CALLS.index(call), nth)
    starts = {**dict(_REALS), "at": at}
    describe = _fmi2 if version == "2.0" else _fmi3
    return compile_fmu(
        _SOURCE,
        describe(name, starts, integers),
        folder / f"{name}.fmu",
        "-pthread",
        "-ffp-contract=off",  # so that its numbers are those of the same sums elsewhere
        resources={"hostile.txt": settings},
    )


def misbehaviour(
    fault: str, call: str = "step", at: float = 0.0, nth: int = 1, **more: float
) -> dict[str, float]:
    """The parameters of a fault.

    Parameters
    ----------
    fault, call : of `FAULTS` and `CALLS`.
    at : the time from which on it happens [s].
    nth : the call of that function from which on it happens, counted from 1.
    more : `beyond`: only while |u| is greater; `seconds` of a sleep; `megabytes` that leak;
        `decay` and `x0` of x' = u - decay x.
    """
    return {"fault": FAULTS.index(fault), "call": CALLS.index(call), "at": at, "nth": nth, **more}


def counts_in(path: Path) -> Counts:
    """Read the file of an FMU that was made with `counts`."""
    return Counts(*np.fromfile(path, np.int64).tolist())


def _items(names: tuple[str, ...]) -> str:
    return "".join(f'<Item name="{n}" value="{i}"/>' for i, n in enumerate(names))


def _fmi2(name: str, starts: dict[str, float], integers: tuple[int, ...]) -> str:
    def variable(name: str, reference: int, kind: str, causality: str = "parameter") -> str:
        fixed = 'variability="fixed"' if causality == "parameter" else ""
        return (
            f'<ScalarVariable name="{name}" valueReference="{reference}" causality="{causality}" '
            f"{fixed}>{kind}</ScalarVariable>"
        )

    reals = "".join(
        variable(name, _FIRST_REAL + i, f'<Real start="{value!r}"/>')
        for i, (name, value) in enumerate(starts.items())
    )
    kinds = (
        *(f'<Enumeration declaredType="{t}" start="{{}}"/>' for t in ("Fault", "Call")),
        '<Integer start="{}"/>',
    )
    whole = "".join(
        variable(name, _FIRST_INTEGER + i, kinds[i].format(integers[i]))
        for i, name in enumerate(("fault", "call", "nth"))
    )
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{name}">
<CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true"
 canGetAndSetFMUstate="true" canSerializeFMUstate="true"/>
<TypeDefinitions>
<SimpleType name="Fault"><Enumeration>{_items(FAULTS)}</Enumeration></SimpleType>
<SimpleType name="Call"><Enumeration>{_items(CALLS)}</Enumeration></SimpleType>
</TypeDefinitions>
<LogCategories><Category name="logAll"/></LogCategories>
<ModelVariables>{variable("u", 0, '<Real start="0"/>', "input")}
{variable("x", 1, "<Real/>", "output")}{reals}{whole}</ModelVariables>
<ModelStructure><Outputs><Unknown index="2" dependencies=""/></Outputs>
<InitialUnknowns><Unknown index="2" dependencies=""/></InitialUnknowns></ModelStructure>
</fmiModelDescription>
"""


def _fmi3(name: str, starts: dict[str, float], integers: tuple[int, ...]) -> str:
    reals = "".join(
        f'<Float64 name="{name}" valueReference="{_FIRST_REAL + i}" causality="parameter" '
        f'variability="fixed" start="{value!r}"/>'
        for i, (name, value) in enumerate(starts.items())
    )
    whole = "".join(
        f'<{kind} name="{name}" valueReference="{_FIRST_INTEGER + i}" causality="parameter" '
        f'variability="fixed" {declared} start="{integers[i]}"/>'
        for i, (name, kind, declared) in enumerate(
            (
                ("fault", "Enumeration", 'declaredType="Fault"'),
                ("call", "Enumeration", 'declaredType="Call"'),
                ("nth", "Int64", ""),
            )
        )
    )
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="{name}" instantiationToken="{name}">
<CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true"
 canGetAndSetFMUState="true" canSerializeFMUState="true"/>
<TypeDefinitions>
<EnumerationType name="Fault">{_items(FAULTS)}</EnumerationType>
<EnumerationType name="Call">{_items(CALLS)}</EnumerationType>
</TypeDefinitions>
<LogCategories><Category name="logAll"/></LogCategories>
<ModelVariables>
<Float64 name="time" valueReference="99" causality="independent" variability="continuous"/>
<Float64 name="u" valueReference="0" causality="input" start="0"/>
<Float64 name="x" valueReference="1" causality="output"/>{reals}{whole}</ModelVariables>
<ModelStructure><Output valueReference="1" dependencies=""/>
<InitialUnknown valueReference="1" dependencies=""/></ModelStructure>
</fmiModelDescription>
"""
