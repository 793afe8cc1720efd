"""Validate a model description with FMPy, and give its messages the codes of this inspection.

FMPy checks combinations of causality, variability and initial, start values and initial unknowns.
It gets only the XML, since it does not guard against hostile ZIP files.
"""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Iterator

from fmpy.model_description import ValidationError, read_model_description

from cosim.fmu.inspect.declared_model import XML
from cosim.fmu.inspect.findings import Finding, finding

# FMPy's message -> code; None for what the checks here report in more detail
_SENTENCES: tuple[tuple[str, str | None], ...] = (
    (r"The variable name .* is not unique", None),
    (r"must have variability != ", "not-continuous"),
    (r"has no start value", "start-missing"),
    (r"(The combination causality|illegal combination)", "combination"),
    (r"but provides a start value", "start-superfluous"),
    (r'The unit ".*" of variable', "unit-undefined"),
    (r"The display unit", "unit-display"),
    (r"contains an illegal", None),
    (r"Exactly one independent", "independent"),
    (r"has the same value reference", None),
    (r"(If dependenciesKind exists|Either both or none|The number of elements)", None),
    (r"ModelStructure/Outputs must have", None),
    (r"referenced by the continuous state derivative", "structure-derivative"),
    (r"ModelStructure/InitialUnknowns does not", "structure-initial"),
    (r"The derivative attribute of model variable", None),
    (r"which has not been defined", None),
)
_LINE = re.compile(r" \(line (\d+)\)")


def fmpy_findings(xml: bytes) -> Iterator[Finding]:
    """Return FMPy's objections to a model description that is valid against the schema.

    If FMPy fails, one finding "fmpy-refuses" stands for all that it did not check.
    """
    shell = io.BytesIO()
    with zipfile.ZipFile(shell, "w") as archive:
        archive.writestr(XML, xml)
    try:
        read_model_description(shell, validate=True, validate_model_structure=True)
    except ValidationError as error:
        for sentence in error.problems:
            yield from _sorted(sentence)
    except Exception as error:  # noqa: BLE001 - FMPy raises many kinds
        if type(error) is Exception and (found := list(_sorted(str(error)))):
            yield from found
        else:
            text = f"FMPy ends with {type(error).__name__}: {error}"
            yield finding("fmpy-refuses", XML, text, level="warning")


def _sorted(sentence: str) -> Iterator[Finding]:
    line = _LINE.search(sentence)
    where = f"{XML}:{line[1]}" if line else XML
    what = _LINE.sub("", sentence)
    for pattern, code in _SENTENCES:
        if re.search(pattern, sentence):
            if code is not None:
                yield finding(code, where, what)
            return
    yield finding("fmpy-refuses", where, what)
