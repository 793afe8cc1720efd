"""A scenario as data: components, connections, links, reference, design, events, assertions.

Times are in seconds, angles in radians, everything else in the SI unit of its variable; a text
with a unit may replace a number: `step = "50 ms"`.
"""

from __future__ import annotations

import re
from itertools import pairwise
from typing import Annotated, Any, Literal, Self

import tomli_w
from pydantic import AfterValidator, ConfigDict, Field, field_validator, model_validator

from cosim.master import Algorithm, Policy, UnknownFeedthrough
from cosim.scenario.events import AssertionPart, EventPart
from cosim.scenario.fields import (
    Angle,
    Delay,
    Duration,
    FmiValue,
    Frequency,
    Name,
    NotNegative,
    Number,
    Part,
    PerSecond,
    Positive,
    Rate,
    Reference,
    SignalValue,
    Speed,
    Text,
)
from cosim.scenario.links import LinkPart
from cosim.scenario.quantity import TIME, quantity_in
from cosim.scenario.run_limits import LimitsPart


class RunPart(Part):
    """[run]: end, communication step, algorithm, seed.

    `algorithm` : "jacobi": all components step with the values exchanged at the same point;
    "gauss-seidel": one after the other in `order`, each with the new outputs of those before it
    (without `order`: senders before receivers, as far as possible).
    `divergence` : largest magnitude of any output in range; without it a million times the nominal
    value of an output that declares one.
    `threads` : on so many the components step side by side, with the same results; worth it where
    a step takes far more than 10 microseconds.
    `unknown_feedthrough` : algebraic loops through outputs whose dependencies the FMU does not
    declare: "refuse" them, or delay as few connections of each as cut it by one step, "previous".
    `solve` : solve algebraic loops at every communication point: inputs are exchanged until none
    changes by more than `solve_tolerance`, relative to the greater of its magnitude and 1, or
    fail after `solve_limit` iterations.
    `supervise` : run the components in a child process, so that a component that crashes or hangs
    ends the run and not the command.
    """

    end: Duration
    step: Duration
    algorithm: Algorithm = "jacobi"
    order: list[Name] | None = None
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    events: Literal["align", "grid"] = "align"
    divergence: Positive | None = None
    threads: Annotated[int, Field(ge=1, le=256)] = 1
    unknown_feedthrough: UnknownFeedthrough = "refuse"
    solve: bool = False
    solve_tolerance: Positive = 1e-10
    solve_limit: Annotated[int, Field(ge=1, le=1_000_000)] = 100
    supervise: bool = True


class ComponentPart(Part):
    """[components.NAME]: an FMU of the catalogue by name, or any `.fmu` path.

    `step` : its own communication step; without one it communicates at every point. Parameters
    and start values have the variable's type: numbers (in the variable's unit, or with one),
    texts, truth values, and nested lists of them for arrays. `feedthrough` : the outputs that
    depend on inputs at the same instant, in place of what the FMU declares: "none", or a list of
    names; a group's name means all its outputs, an element's name its whole array. `isolate` : its
    slave is in a process of its own, so that it cannot harm the others, and an FMU that allows one
    instance per process can be there several times.
    """

    fmu: Text
    step: Duration | None = None
    feedthrough: Literal["none"] | list[Text] | None = None
    isolate: bool = False
    parameters: dict[str, FmiValue] = Field(default_factory=dict)


class ConnectionPart(Part):
    """[[connections]]: `from = "plant.eta"` means every variable `eta.*` or `eta[...]`.

    `policy` : the value of the input during a step: that at its beginning ("hold"), or that at
    its middle, known from a transport delay ("midpoint") or extrapolated ("linear"), or that of
    one communication point before ("previous"), which cuts an algebraic loop.
    """

    source: Reference = Field(alias="from")
    target: Reference = Field(alias="to")
    link: Name | None = None
    policy: Policy = "hold"


_SHORT = re.compile(
    r"\s*(?P<source>[A-Za-z][\w-]*\.\S+)\s*->\s*(?P<target>[A-Za-z][\w-]*\.\S+)"
    r"(?:\s+:\s*(?P<link>[A-Za-z][\w-]*))?\s*",
    re.ASCII,
)


def connection_of(text: str) -> ConnectionPart:
    """Parse the short form `"plant.eta -> controller.eta : uplink"`; ValueError if it is none."""
    found = _SHORT.fullmatch(text)
    if found is None:
        raise ValueError('as in "plant.eta -> controller.eta" or, over a link, "... : uplink"')
    given = {"from": found["source"], "to": found["target"]}
    if found["link"] is not None:
        given["link"] = found["link"]
    return ConnectionPart.model_validate(given)


def _connect(text: str) -> str:
    connection_of(text)
    return text


Connect = Annotated[str, AfterValidator(_connect)]


def _seconds(value: Any) -> Any:
    """Return a time as a number; a QuantityError is a ValueError, which pydantic reports."""
    return quantity_in(value, TIME) if isinstance(value, str) else value


class PathPart(Part):
    """[reference]: a path through points, for inputs that follow it.

    `points` are rows of time and one value per axis; between two points the path is a straight
    line, with a speed that starts and ends at zero ("smooth") or is constant ("linear"); before
    the first and after the last point it is constant.
    """

    target: Reference
    axes: Annotated[list[str], Field(min_length=1)]
    points: Annotated[list[list[SignalValue]], Field(min_length=1)]
    interpolation: Literal["smooth", "linear"] = "smooth"

    @field_validator("points", mode="after")
    @classmethod
    def _times(cls, points: list[list[Any]]) -> list[list[Any]]:
        return [[_seconds(value) for value in point[:1]] + point[1:] for point in points]

    @model_validator(mode="after")
    def _shape(self) -> Self:
        if len(set(self.axes)) != len(self.axes):
            raise ValueError(f"the axes must differ; got {', '.join(self.axes)}")
        for i, point in enumerate(self.points):
            if len(point) != 1 + len(self.axes):
                raise ValueError(
                    f"point {i + 1} has {len(point)} numbers; expected a time and "
                    f"{len(self.axes)} values ({', '.join(self.axes)})"
                )
        times = [point[0] for point in self.points]
        if any(b <= a for a, b in pairwise(times)):
            raise ValueError("the times of the points must increase")
        return self


class DisturbancePart(Part):
    """[disturbance]: the worst-case disturbance of the scenario's design.

    "worst-case": the sinusoid that the nominal loop amplifies most, at the frequency of its peak
    or at `omega` [rad/s], |w| at most `amplitude`, with the envelope sin(pi t / end). At frequency
    zero that is a constant; a peak at infinite frequency is attained by no disturbance and
    refused. `target` is a group of inputs, one per entry of w in Eq. (7).
    """

    kind: Literal["worst-case"]
    target: Reference
    amplitude: Positive
    omega: Frequency | None = None


class EnvelopePart(Part):
    """Largest |u|, |v|, |w| [m/s], |r| [rad/s] and |psi| [rad] that the design allows for."""

    u: Speed
    v: Speed
    w: Speed
    r: Rate
    psi: Angle


MADE_WITH = ("gain", "order", "k1", "k2")
"""Keys of [design] that say how a design is made, not for which system."""


class DesignPart(Part):
    """[design]: the gain of the controller, and the system for which it is proved.

    `file` : use this design: a `.json` that `cosim design --save` wrote, a `.fmu` that `cosim fmu
    controller` made of one, or the name of a design of the package; other keys about the system
    must agree with it. Without `file` the gain of
    least gamma is designed, or `gain` is analysed.
    `least_age`, `rate` and `sampled` say more of the age of the feedback, as in the file of a
    system; without them a design made here is proved for what the links justify.
    """

    model_config = ConfigDict(
        json_schema_extra={"anyOf": [{"required": ["system"]}, {"required": ["file"]}]}
    )
    system: Text | None = None
    file: Text | None = None
    controller: Name = "controller"
    plant: Name = "plant"
    gain: list[list[Number]] | None = None
    k1: list[Number] | None = None
    k2: list[Number] | None = None
    order: Annotated[int, Field(ge=0, le=12)] | None = None
    state_delay: Delay | None = None
    loop_delay: Delay | None = None
    least_age: Delay | None = None
    rate: NotNegative | None = None
    sampled: bool | None = None
    damping: Annotated[list[PerSecond], Field(min_length=4, max_length=4)] | None = None
    position_weight: Positive | None = None
    envelope: EnvelopePart | None = None

    @model_validator(mode="after")
    def _source(self) -> Self:
        if self.system is None and self.file is None:
            raise ValueError("a system to design for, or the file of a design: system or file")
        beside = [key for key in MADE_WITH if getattr(self, key) is not None]
        if self.file is not None and beside:
            raise ValueError(
                f"{', '.join(beside)} beside file: the gain and its proof are those of the file; "
                "leave out file to have a design made"
            )
        lengths = sorted({len(row) for row in self.gain or ()})
        if len(lengths) > 1:
            raise ValueError(
                f"the rows of gain must be of one length; got {' and '.join(map(str, lengths))}"
            )
        return self


Level = Literal["debug", "info", "warning", "error"]


class ComponentLogPart(Part):
    """[log.components.NAME]: which log messages of one component are recorded.

    `categories` : the FMU's log categories to record; a status above Warning is always recorded.
    """

    level: Level | None = None
    categories: list[str] | None = None


class LogPart(Part):
    """[log]: lowest level at which messages of components and master are recorded."""

    level: Level = "debug"
    components: dict[Name, ComponentLogPart] = Field(default_factory=dict)


class Scenario(Part):
    """A whole scenario."""

    title: Text
    description: str = ""
    run: RunPart
    components: Annotated[dict[Name, ComponentPart], Field(min_length=1)]
    connections: list[ConnectionPart] = Field(default_factory=list)
    connect: list[Connect] = Field(default_factory=list)
    links: dict[Name, LinkPart] = Field(default_factory=dict)
    reference: PathPart | None = None
    disturbance: DisturbancePart | None = None
    design: DesignPart | None = None
    events: list[EventPart] = Field(default_factory=list)
    assertions: list[AssertionPart] = Field(default_factory=list)
    log: LogPart | None = None
    limits: LimitsPart | None = None

    def to_data(self) -> dict[str, Any]:
        """Return the tables of the scenario, without defaults."""
        return self.model_dump(by_alias=True, exclude_unset=True, exclude_none=True)

    def to_toml(self) -> str:
        """Return TOML text that reads back as this scenario."""
        return tomli_w.dumps(self.to_data(), multiline_strings="\r" not in self.description)

    def wires(self) -> list[tuple[tuple[str, int], ConnectionPart]]:
        """Return the connections of both forms, each with its path."""
        short = [(("connect", i), connection_of(text)) for i, text in enumerate(self.connect)]
        return [(("connections", i), part) for i, part in enumerate(self.connections)] + short
