"""Which output fits which input, from the words of the rule alone; nothing of cosim is used.

A model is plain data: variables, what its units are in base units, and terminals.
"""

from __future__ import annotations

from dataclasses import dataclass, field

KINDS = {
    "Real": "real",
    "Float64": "real",
    "Float32": "real",
    "Integer": "whole",
    "Int32": "whole",
    "UInt8": "whole",
    "Int64": "whole",
    "Boolean": "truth",
    "String": "text",
}
RANGES = {
    "Integer": (-(2**31), 2**31 - 1),
    "Int32": (-(2**31), 2**31 - 1),
    "UInt8": (0, 255),
    "Int64": (-(2**63), 2**63 - 1),
}
BY_NAME = {
    "m": ("length", 1.0, 0.0),
    "cm": ("length", 0.01, 0.0),
    "K": ("temperature", 1.0, 0.0),
    "degC": ("temperature", 1.0, 273.15),
    "rad": ("angle", 1.0, 0.0),
}
"""Units that are known without a definition: what they measure, factor, offset to SI."""


@dataclass
class Variable:
    name: str
    causality: str
    type: str
    shape: tuple[int, ...] = ()
    unit: str | None = None


@dataclass
class Terminal:
    name: str
    rule: str
    kind: str | None
    members: list[tuple[str, str]]


@dataclass
class Model:
    variables: list[Variable]
    units: dict[str, tuple[str, float, float]] = field(default_factory=dict)
    terminals: list[Terminal] = field(default_factory=list)

    def named(self, name: str) -> Variable | None:
        return next((v for v in self.variables if v.name == name), None)

    def meaning(self, unit: str) -> tuple[str, float, float] | None:
        return self.units.get(unit) or BY_NAME.get(unit)


Wire = tuple[str, str, float, float]
"""Output and input as component.variable, gain, offset."""


def wires_of(models: dict[str, Model]) -> tuple[list[Wire], list[str]]:
    """The wires, and the inputs that are left open."""
    wires, left = [], []
    for mine, model in models.items():
        for taker in (v for v in model.variables if v.causality == "input"):
            others = [(name, other) for name, other in models.items() if name != mine]
            by_name = [
                (name, v)
                for name, other in others
                for v in other.variables
                if v.name == taker.name and v.causality == "output"
            ]
            by_terminal = [
                (name, v)
                for name, other in others
                for v in other.variables
                if any(
                    (v.name, taker.name) in meets(there, here, other, model)
                    for here in model.terminals
                    for there in other.terminals
                    if here.name == there.name
                )
            ]
            for candidates in (by_name, by_terminal):
                fitting = [
                    (f"{name}.{v.name}", f"{mine}.{taker.name}", *numbers)
                    for name, v in candidates
                    if (numbers := conversion(v, models[name], taker, model)) is not None
                ]
                if fitting:
                    break
            if len(fitting) == 1:
                wires.append(fitting[0])
            else:
                left.append(f"{mine}.{taker.name}")
    return wires, left


def conversion(
    giver: Variable, of: Model, taker: Variable, to: Model
) -> tuple[float, float] | None:
    """Gain and offset between two variables; None if they do not fit."""
    if not may_meet(giver, taker):
        return None
    if giver.unit is None or taker.unit is None:
        return 1.0, 0.0
    a, b = of.meaning(giver.unit), to.meaning(taker.unit)
    if a is None or b is None:
        return (1.0, 0.0) if giver.unit == taker.unit else None
    if (a, giver.unit) == (b, taker.unit):
        return 1.0, 0.0
    alone = KINDS[giver.type] == "real" and not giver.shape and not taker.shape
    if a[0] != b[0] or not alone:
        return None
    return a[1] / b[1], (a[2] - b[2]) / b[1]


def may_meet(giver: Variable, taker: Variable) -> bool:
    """Whether types and sizes are those of a connection."""
    if KINDS[giver.type] == "whole":
        (low, high), (least, most) = RANGES[giver.type], RANGES.get(taker.type, (1, 0))
        if low < least or high > most:
            return False
    alone = {giver.shape, taker.shape} <= {(), (1,), (1, 1)}
    return KINDS[giver.type] == KINDS[taker.type] and (giver.shape == taker.shape or alone)


def meets(there: Terminal, here: Terminal, other: Model, model: Model) -> set[tuple[str, str]]:
    """The pairs of an output there and an input here that two terminals connect."""
    if (there.rule, there.kind) != (here.rule, here.kind):
        return set()
    theirs, mine = dict(there.members), dict(here.members)
    if here.rule == "bus":
        pairs = [(theirs[name], mine[name]) for name in theirs if name in mine]
    elif here.rule == "sequence":
        if len(there.members) != len(here.members):
            return set()
        both = zip(there.members, here.members, strict=True)
        pairs = [(a[1], b[1]) for a, b in both]
    else:
        if set(theirs) != set(mine):
            return set()
        pairs = [(theirs[name], mine[name]) for name in theirs]
    found = set()
    for given, taken in pairs:
        causalities = [
            None if v is None else v.causality for v in (other.named(given), model.named(taken))
        ]
        if causalities == ["output", "input"]:
            found.add((given, taken))
        elif causalities != ["input", "output"] and {"input", "output"} & set(causalities):
            return set()  # two outputs, two inputs, or one beside nothing
    return found
