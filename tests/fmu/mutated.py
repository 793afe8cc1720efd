"""Model descriptions with one change each, and what the standard says of each.

    python -m tests.fmu.mutated

prints a table: how many the standard forbids, and what `cosim fmu check` and FMPy's validation
miss, or refuse wrongly. The verdicts are from the texts of FMI 2.0.4 and 3.0.2, not from a tool.
"""

from __future__ import annotations

import io
import sys
import tempfile
import zipfile
from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from lxml import etree

sys.path.insert(0, str(Path(__file__).parents[1]))
from fmu.packed import XML, example, inspected

from cosim.fmu.inspect import GROUPS, RULES


class Mutation(NamedTuple):
    """A changed description; `allowed` says whether the standard allows it."""

    group: str
    name: str
    description: str
    allowed: bool


# base, old, new; the standard allows each result
ALLOWED = (
    ("fmi1", 'causality="input"><Real start="0"/>', 'causality="input"><Integer start="0"/>'),
    ("fmi2", ' displayUnit="mm"', ""),
    ("fmi2", 'displayUnit="mm"', 'displayUnit="ell"'),  # 2.2.3: it is ignored
    ("fmi2", '<Item name="neutral" value="0"/>', ""),
    ("fmi2", ' dependenciesKind="constant"/>\n   <Unknown index="9"', '/>\n   <Unknown index="9"'),
    ("fmi2", ' causality="independent"><Real unit="s"/>', ' causality="independent"><Real/>'),
    ("fmi2", 'variableNamingConvention="structured" ', ""),
    ("fmi2", 'reinit="true"', 'reinit="false"'),
    ("fmi2", 'name="on" valueReference="0"', 'name="on" valueReference="77"'),
    (
        "fmi2",
        'variability="constant">\n   <Real',
        'variability="constant" initial="exact">\n   <Real',
    ),
    (
        "fmi2",
        '<Category name="logEvents"/><Category name="logStatusError"/>',
        '<Category name="logAll"/>',
    ),
    ("fmi2", 'name="twice.k"', 'name="der(twice.k[1,2],3)"'),
    ("fmi2", 'name="twice.k"', "name=\"twice.'k 1 \\\\n'\""),
    ("fmi2", '<BaseUnit m="1" s="-1"/>', '<BaseUnit m="1" s="-1" factor="1"/>'),
    ("fmi3", 'fmiVersion="3.0"', 'fmiVersion="3.0.2"'),
    ("fmi3", ' variability="continuous" unit="s"', ""),
    ("fmi3", '<Float64 name="time"', '<Float32 name="time"'),
    ("fmi3", 'start="0 0"', 'start="0"'),
    ("fmi3", 'start="0 0"', 'start="INF -INF"'),
    ("fmi3", '<Start\n   value="a"/>', ""),
    ("fmi3", ' intermediateUpdate="true"', ""),
    ("fmi3", '<Alias name="z" displayUnit="mm"/>', '<Alias name="z"/>'),
    (
        "fmi3",
        ' supportsFraction="true" resolution="4"\n   intervalCounter="2" shiftCounter="1"',
        "",
    ),
    ("fmi3", 'intervalVariability="constant"', 'intervalVariability="tunable"'),
    ("fmi3", 'name="alarm" valueReference="16"', 'name="alarm" clocks="15" valueReference="16"'),
    ("fmi3", '<EventIndicator valueReference="19"/>', ""),
    (
        "fmi3",
        '<InitialUnknown valueReference="9"',
        '<InitialUnknown valueReference="17"/><InitialUnknown valueReference="9"',
    ),
    ("fmi3", '<Int32 name="count"', '<Int8 name="count"'),
    ("fmi3", ' min="0"\n   max="9" start="2"', ' start="2"'),
    ("fmi3", 'name="on" valueReference="12"', 'name="on" valueReference="4294967295"'),
)
# base, old, new; the standard forbids each result, beside the examples of the rules
FORBIDDEN = (
    ("fmi1", 'name="y"', 'name="u"'),
    ("fmi1", 'modelIdentifier="Example"', 'modelIdentifier="no name"'),
    ("fmi1", 'guid="{1}"', ""),
    ("fmi1", 'causality="output"', 'causality="parameter"'),
    ("fmi1", "<Real/>", '<Real declaredType="gone"/>'),
    ("fmi2", 'canGetAndSetFMUstate="true" ', ""),
    (
        "fmi2",
        'causality="input" variability="continuous"',
        'causality="input" variability="continuous" initial="exact"',
    ),
    ("fmi2", '<Real unit="m/s" start="0"/>', '<Real unit="m/s"/>'),
    ("fmi2", '<Real unit="m/s" derivative="2"/>', '<Real unit="m/s" derivative="2" start="0"/>'),
    ("fmi2", '<Real unit="m/s" derivative="2"/>', '<Real unit="m/s" derivative="3"/>'),
    ("fmi2", '<Real unit="m/s" derivative="2"/>', '<Real unit="m/s" derivative="9"/>'),
    ("fmi2", 'causality="independent"><Real unit="s"/>', 'causality="independent"><Integer/>'),
    ("fmi2", '<Boolean start="true"/>', '<Boolean start="yes"/>'),
    ("fmi2", '<Integer start="0" min="0"', '<Integer start="-1" min="0"'),
    ("fmi2", '<Integer start="0" min="0"', '<Integer start="0" min="200"'),
    ("fmi2", '<Integer start="0" min="0"', '<Integer start="3000000000" min="0"'),
    ("fmi2", 'declaredType="Gear" start="1"', 'start="1"'),
    ("fmi2", 'declaredType="Gear" start="1"', 'declaredType="Gear" start="7"'),
    ("fmi2", 'declaredType="Length"', 'declaredType="Gear"'),
    ("fmi2", 'unit="m" displayUnit="mm"', 'displayUnit="mm"'),
    ("fmi2", '<Real unit="m"/>', '<Real unit="ell"/>'),
    ("fmi2", 'name="Length"', 'name="x"'),
    ("fmi2", '<Unit name="s">', '<Unit name="K">'),
    (
        "fmi2",
        '<DisplayUnit name="mm" factor="1000"/>',
        '<DisplayUnit name="mm"/><DisplayUnit name="mm"/>',
    ),
    ("fmi2", '<Item name="neutral" value="0"/>', '<Item name="neutral" value="-1"/>'),
    ("fmi2", '<Category name="logStatusError"/>', '<Category name="logEvents"/>'),
    ("fmi2", 'name="k" valueReference="4"', 'name="k" valueReference="0"'),
    ("fmi2", 'name="k" valueReference="4"', 'name="k" valueReference="-4"'),
    ("fmi2", 'name="k"', 'name="x"'),
    ("fmi2", 'name="k"', 'name="k..k"'),
    ("fmi2", 'name="k"', 'name=""'),
    ("fmi2", '<Unknown index="9" dependencies=""/>', ""),
    ("fmi2", '<Unknown index="9" dependencies=""/>', '<Unknown index="8" dependencies=""/>'),
    ("fmi2", '<Unknown index="9" dependencies=""/>', '<Unknown index="99" dependencies=""/>'),
    ("fmi2", '<Unknown index="9" dependencies=""/>', '<Unknown index="9" dependencies="99"/>'),
    (
        "fmi2",
        '<Unknown index="9" dependencies=""/>',
        '<Unknown index="9" dependencies=""/><Unknown index="9" dependencies=""/>',
    ),
    ("fmi2", '<Derivatives><Unknown index="3"', '<Derivatives><Unknown index="5"'),
    ("fmi2", 'dependenciesKind="tunable constant"', 'dependenciesKind="tunable"'),
    ("fmi2", 'dependenciesKind="tunable constant"', 'dependenciesKind="tunable odd"'),
    ("fmi2", '   <Unknown index="7" dependencies="6"/>\n', ""),
    ("fmi2", '<Unknown index="7" dependencies="6"/>', '<Unknown index="7"/><Unknown index="9"/>'),
    ("fmi3", 'fmiVersion="3.0"', 'fmiVersion="4.0"'),
    ("fmi3", 'instantiationToken="{1}"', ""),
    ("fmi3", 'providesIntermediateUpdate="true"', ""),
    ("fmi3", 'causality="independent"', 'causality="local"'),
    ("fmi3", 'causality="independent"', 'causality="independent" initial="exact"'),
    ("fmi3", '<Float64 name="time"', '<Int32 name="time"'),
    ("fmi3", '<UInt64 name="n"', '<UInt32 name="n"'),
    ("fmi3", 'max="9" start="2"/>\n  <UInt64', 'max="9"/>\n  <UInt64'),
    ("fmi3", 'max="9" start="2"/>\n  <UInt64', 'max="9" start="0"/>\n  <UInt64'),
    ("fmi3", 'variability="constant" start="2"', 'start="2" initial="exact"'),
    ("fmi3", '<Dimension start="2"/></Float64>', '<Dimension start="0"/></Float64>'),
    ("fmi3", '<Dimension start="2"/></Float64>', "<Dimension/></Float64>"),
    (
        "fmi3",
        '<Dimension start="2"/></Float64>',
        '<Dimension start="2" valueReference="2"/></Float64>',
    ),
    ("fmi3", '<Dimension start="2"/></Float64>', '<Dimension valueReference="99"/></Float64>'),
    ("fmi3", 'start="0 0"', 'start="0 0 0"'),
    ("fmi3", ' start="0 0"', ""),
    ("fmi3", 'nominal="2" start="2"', 'nominal="2" start="2 2"'),
    ("fmi3", '<Alias name="z"', '<Alias name="y"'),
    ("fmi3", 'intermediateUpdate="true"', 'intermediateUpdate="1" variability="discrete"'),
    ("fmi3", ' reinit="true"', ' derivative="5"'),
    ("fmi3", 'name="k" valueReference="8"', 'name="k" reinit="true" valueReference="8"'),
    ("fmi3", 'declaredType="Gear" start="1"', 'start="1"'),
    ("fmi3", 'declaredType="Gear" start="1"', 'declaredType="Gear" start="2"'),
    (
        "fmi3",
        '<Binary name="image" valueReference="14" causality="input"><Start value="00ff"/>',
        '<Binary name="image" valueReference="14" causality="input"><Start value="0xff"/>',
    ),
    ("fmi3", '<Start value="00ff"/>', ""),
    ("fmi3", ' intervalVariability="constant"', ""),
    (
        "fmi3",
        'causality="input" intervalVariability="constant"',
        'causality="parameter" intervalVariability="constant"',
    ),
    ("fmi3", 'intervalVariability="constant"', 'intervalVariability="countdown"'),
    ("fmi3", 'intervalVariability="constant"', 'intervalVariability="triggered"'),
    ("fmi3", 'intervalDecimal="0.5"', ""),
    ("fmi3", 'intervalDecimal="0.5"', 'intervalDecimal="-1"'),
    ("fmi3", 'shiftDecimal="0.25"', 'shiftDecimal="-0.25"'),
    ("fmi3", 'intervalCounter="2"', 'intervalCounter="0"'),
    ("fmi3", ' resolution="4"', ""),
    ("fmi3", 'supportsFraction="true"', 'supportsFraction="false"'),
    ("fmi3", 'name="alarm"', 'name="alarm" priority="1"'),
    ("fmi3", 'clocks="15" previous="18"', 'previous="18"'),
    ("fmi3", 'clocks="15" previous="18"', 'clocks="15" previous="17"'),
    ("fmi3", 'clocks="15" previous="18"', 'clocks="15" previous="11"'),
    ("fmi3", 'clocks="15" previous="18"', 'clocks="99" previous="18"'),
    ("fmi3", 'clocks="15" previous="18"', 'clocks="" previous="18"'),
    ("fmi3", 'name="crossing"', 'name="crossing" clocks="15"'),
    ("fmi3", 'name="crossing"', 'name="crossing" previous="18" variability="discrete" clocks="15"'),
    ("fmi3", '<Output valueReference="16" dependencies="5"/>\n', ""),
    ("fmi3", '<Output valueReference="16"', '<Output valueReference="19"'),
    ("fmi3", '<ClockedState valueReference="17"', '<ClockedState valueReference="15"'),
    (
        "fmi3",
        '<ContinuousStateDerivative valueReference="6"',
        '<ContinuousStateDerivative valueReference="19"',
    ),
    ("fmi3", '<InitialUnknown valueReference="7"', '<InitialUnknown valueReference="8"'),
    (
        "fmi3",
        '<InitialUnknown valueReference="7" dependencies="5" dependenciesKind="constant"',
        '<InitialUnknown valueReference="7" dependencies="5" dependenciesKind="fixed"',
    ),
    ("fmi3", 'inverse="true"', 'inverse="true" offset="2"'),
)

# FMI 2.0.4, 2.2.7, and FMI 3.0.2, 2.4.7.4 and 2.4.7.5: default first; "-" is none
_INITIAL = {
    "structuralParameter": {"fixed": ("exact",), "tunable": ("exact",)},
    "parameter": {"fixed": ("exact",), "tunable": ("exact",)},
    "calculatedParameter": dict.fromkeys(("fixed", "tunable"), ("calculated", "approx")),
    "input": {"discrete": ("exact",), "continuous": ("exact",)},
    "output": {"constant": ("exact",)}
    | dict.fromkeys(("discrete", "continuous"), ("calculated", "exact", "approx")),
    "local": {"constant": ("exact",)}
    | dict.fromkeys(("fixed", "tunable"), ("calculated", "approx"))
    | dict.fromkeys(("discrete", "continuous"), ("calculated", "exact", "approx")),
    "independent": {"continuous": ("-",)},
}
_VARIABILITIES = ("constant", "fixed", "tunable", "discrete", "continuous")
_INITIALS = (None, "exact", "approx", "calculated")


def mutations() -> Iterator[Mutation]:
    """Give every mutation: those of lists, the rules' examples, every combination."""
    for code, rule in RULES.items():
        if rule.base and (rule.level == "error" or code == "start-number"):
            yield Mutation(GROUPS[rule.number[0]], code, rule.broken(), allowed=False)
    for allowed, changes in ((True, ALLOWED), (False, FORBIDDEN)):
        for base, old, new in changes:
            before = example(base)
            if old not in before:
                raise ValueError(f"{base} has no {old}")
            text = before.replace(old, new, 1)
            yield Mutation(f"by hand, {base}", f"{old} -> {new}", text, allowed)
    for version, causality, variability in product("23", _INITIAL, _VARIABILITIES):
        if version == "2" and causality == "structuralParameter":
            continue
        for initial, start in product(_INITIALS, (False, True)):
            yield _combination(version, causality, variability, initial, start=start)


def _combination(
    version: str, causality: str, variability: str, initial: str | None, *, start: bool
) -> Mutation:
    """Describe one variable of this combination, with all else as the standard asks for."""
    options = _INITIAL[causality].get(variability, ())
    effective = initial or (options[0] if options else "-")
    allowed = bool(options) and (effective in options or (initial is None and "-" in options))
    if version == "2" and causality == "input" and initial is not None:
        allowed = False
    allowed = allowed and start == (effective in ("exact", "approx"))
    given = f'causality="{causality}" variability="{variability}"'
    given += "" if initial is None else f' initial="{initial}"'
    value = ' start="1"' if start else ""
    output = causality == "output"
    unknown = causality == "calculatedParameter" or (
        output and effective in ("approx", "calculated")
    )
    name = f"{causality} {variability} {initial} {'start' if start else 'no start'}"
    if version == "2":
        variable = (
            f'<ScalarVariable name="v" valueReference="1" {given}><Real{value}/></ScalarVariable>'
        )
        lists = '<Outputs><Unknown index="1"/></Outputs>' * output
        lists += '<InitialUnknowns><Unknown index="1"/></InitialUnknowns>' * unknown
        head = 'fmiVersion="2.0" modelName="m" guid="1"'
    else:
        variable = f'<Float64 name="v" valueReference="1" {given}{value}/>'
        if causality != "independent":
            variable += '<Float64 name="t" valueReference="2" causality="independent"/>'
        lists = '<Output valueReference="1"/>' * output
        lists += '<InitialUnknown valueReference="1"/>' * unknown
        head = 'fmiVersion="3.0" modelName="m" instantiationToken="1"'
    text = (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<fmiModelDescription {head}>'
        f'<CoSimulation modelIdentifier="m"/><ModelVariables>{variable}</ModelVariables>'
        f"<ModelStructure>{lists}</ModelStructure></fmiModelDescription>"
    )
    return Mutation(f"combinations, fmi{version}", name, text, allowed)


def our_errors(description: str) -> list[str]:
    """The codes of the errors that the check finds."""
    with tempfile.TemporaryDirectory() as folder:
        found = inspected(description, Path(folder)).findings
    return [each.code for each in found if each.level == "error"]


def fmpy_problems(description: str) -> list[str]:
    """What FMPy's `validate_fmu` and `read_model_description(validate=True)` object to."""
    from fmpy.validation import validate_fmu  # noqa: PLC0415 - it loads NumPy

    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as packed:
        packed.writestr(XML, description)
    return [str(problem) for problem in validate_fmu(archive)]


class Score(NamedTuple):
    """The mutations of a group that a tool judges wrongly, by name."""

    missed: list[str]
    false_alarms: list[str]


def scores(judge: Callable[[str], list[str]]) -> dict[str, Score]:
    """Group -> what a tool judges wrongly; what it says of a base already does not count."""
    bases = {base: set(judge(example(base))) for base in ("fmi1", "fmi2", "fmi3")}
    known = set().union(*bases.values())
    found: dict[str, Score] = defaultdict(lambda: Score([], []))
    for each in mutations():
        score = found[each.group]
        refused = bool(set(judge(each.description)) - known)
        if refused == each.allowed:
            (score.false_alarms if refused else score.missed).append(each.name)
    for base, objections in bases.items():
        if objections:
            found[f"by hand, {base}"].false_alarms.append(f"the base: {sorted(objections)}")
    return found


def main() -> None:
    """Print the table, and with --names what is judged wrongly."""
    schema: Any = cache(etree.XMLSchema)
    etree.XMLSchema = lambda file: schema(file=Path(file).as_posix())  # FMPy reads it each time
    ours, theirs = scores(our_errors), scores(fmpy_problems)
    counts: dict[str, list[int]] = defaultdict(lambda: [0, 0])
    for each in mutations():
        counts[each.group][each.allowed] += 1
    print(
        "| mutations | forbidden | missed | missed by FMPy | allowed | refused | refused by FMPy |"
    )
    print("|---|--:|--:|--:|--:|--:|--:|")
    rows = []
    for group, (forbidden, allowed) in counts.items():
        a, b = ours.get(group, Score([], [])), theirs.get(group, Score([], []))
        rows.append([forbidden, len(a.missed), len(b.missed), allowed])
        rows[-1] += [len(a.false_alarms), len(b.false_alarms)]
        print(f"| {group} | " + " | ".join(map(str, rows[-1])) + " |")
    print("| all | " + " | ".join(str(sum(column)) for column in zip(*rows, strict=True)) + " |")
    if "--names" in sys.argv:
        for tool, found in (("cosim", ours), ("FMPy", theirs)):
            for group, score in found.items():
                for name in score.missed:
                    print(f"{tool} misses ({group}): {name}")
                for name in score.false_alarms:
                    print(f"{tool} refuses ({group}): {name}")


if __name__ == "__main__":
    main()
