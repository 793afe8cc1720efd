"""A scenario as data: components, connections, links, reference, design, events, assertions.

Times are in seconds, angles in radians, everything else in the SI unit of its variable; a text
with a unit may replace a number: `step = "50 ms"`.
"""

from __future__ import annotations

import re
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, Self

import tomli_w
from pydantic import (
    AfterValidator,
    ConfigDict,
    Discriminator,
    Field,
    PrivateAttr,
    Tag,
    field_validator,
    model_validator,
)

from cosim.core import TIME, KeyPath, NotNegative, Number, Positive, Text
from cosim.master import Algorithm, Policy, UnknownFeedthrough
from cosim.scenario.copies import written_out
from cosim.scenario.events import AssertionPart, EventPart
from cosim.scenario.fields import (
    Angle,
    Delay,
    Duration,
    FmiValue,
    Frequency,
    Instant,
    LinkTime,
    Name,
    Part,
    PerSecond,
    Rate,
    Reference,
    SignalValue,
    Speed,
)
from cosim.scenario.links import LinkPart
from cosim.scenario.media import MediumPart
from cosim.scenario.modes import ModesPart
from cosim.scenario.run_limits import LimitsPart
from cosim.scenario.signal_parts import ComputedPart, InputsPart, SensorPart
from cosim.scenario.values import value_in


class RunPart(Part):
    """[run]: end, communication step, algorithm, seed."""

    end: Duration
    """Time at which the run ends."""
    start: LinkTime = 0.0
    """Time at which it begins, of the components and of everything else that has a time: `end`,
    events, windows, paths, recorded delays, t. Links send their first message then, and `offset`
    later.
    """
    step: Duration
    """Communication step: the components exchange values at its multiples, from the start on."""
    algorithm: Algorithm = "jacobi"
    """How components step. "jacobi": all with the values exchanged at the same point;
    "gauss-seidel": one after the other in `order`, each with the new outputs of those before it.
    """
    order: list[Name] | None = None
    """Order of the components under gauss-seidel; without it senders before receivers, as far as
    possible.
    """
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    """Seed of the links that have none of their own."""
    events: Literal["align", "grid"] = "align"
    """What an instant at which a link sends or delivers is: "align": a communication point;
    "grid": rounded up to the next multiple of the step.
    """
    divergence: Positive | None = None
    """Largest magnitude of any output in range; without it a million times the nominal value of an
    output that declares one.
    """
    threads: Annotated[int, Field(ge=1, le=256)] = 1
    """On so many threads the components step side by side, with the same results; worth it where a
    step takes far more than 10 microseconds.
    """
    unknown_feedthrough: UnknownFeedthrough = "refuse"
    """Algebraic loops through outputs whose dependencies the FMU does not declare: "refuse" them,
    or delay as few connections of each as cut it by one step, "previous".
    """
    solve: bool = False
    """Solve algebraic loops at every communication point, until no input changes."""
    solve_tolerance: Positive = 1e-10
    """Largest change of an input that counts as none, relative to the greater of its magnitude and
    1.
    """
    solve_limit: Annotated[int, Field(ge=1, le=1_000_000)] = 100
    """Iterations after which solving an algebraic loop fails."""
    supervise: bool = True
    """Run the components in a child process, so that a component that crashes or hangs ends the
    run and not the command.
    """

    @model_validator(mode="after")
    def _ends_later(self) -> Self:
        if self.end <= self.start:
            times = f"{self.end:g} s is not after {self.start:g} s"
            raise ValueError(f"an end after the start: {times}")
        return self

    @property
    def start_ns(self) -> int:
        """Time of the components at the beginning of the run [ns]."""
        return round(self.start * 1e9)

    @property
    def lasts_ns(self) -> int:
        """How long the run lasts [ns]."""
        return round(self.end * 1e9) - self.start_ns


class ComponentPart(Part):
    """[components.NAME]: an FMU, one of those here by name, of a design, or any `.fmu` path."""

    fmu: Text
    """A built-in FMU by name, or the path of any `.fmu`, from the folder of the scenario. Of the
    design of a vehicle with an observer, a built-in one or a file, "DESIGN:plant",
    "DESIGN:controller" and "DESIGN:NAME", the sensor of the measurement NAME.
    """
    step: Duration | None = None
    """Communication step of this component; without one it communicates at every point."""
    feedthrough: Literal["none"] | list[Text] | None = None
    """The outputs that depend on inputs at the same instant, in place of what the FMU declares:
    "none", or a list of names; a group's name means all its outputs, an element's name its
    whole array.
    """
    isolate: bool = False
    """The slave is in a process of its own, so that it cannot harm the others, and an FMU that
    allows one instance per process can be there several times.
    """
    event_mode: bool | None = None
    """Whether events and Clocks of an FMI 3.0 FMU are handled in event mode, at communication
    points of their own; without this key, if the FMU offers that. false: it runs by steps alone.
    """
    clocks: dict[Text, Duration | list[Instant]] = Field(default_factory=dict)
    """Ticks of input Clocks: the interval of a fixed or tunable one, or the instants of a triggered
    one that nothing is connected to.
    """
    intermediate: list[Text] = Field(default_factory=list)
    """Outputs that are also recorded within the steps, as often as the FMU offers it, on the topic
    /NAME/intermediate.
    """
    parameters: dict[str, FmiValue] = Field(default_factory=dict)
    """Parameters and start values, of the variable's type: numbers (in the variable's unit, or
    with one), texts, truth values, and nested lists of them for arrays.
    """


class ConnectionPart(Part):
    """[[connections]]: `from = "plant.eta"` means every variable `eta.*` or `eta[...]`."""

    source: Reference = Field(alias="from")
    """Output that sends, `component.variable`; a group's name means all its variables."""
    target: Reference = Field(alias="to")
    """Input that receives, `component.variable`; a group for a group."""
    link: Name | None = None
    """Link that the values take; without one they arrive at once."""
    sensor: Name | None = None
    """Sensor of [sensors] that the values come through first."""
    gain: Number | None = None
    """The input is gain * value + offset, in the units of the two variables."""
    offset: SignalValue | None = None
    """Added after the gain; a text with a unit is converted to that of the input."""
    matrix: Annotated[list[Annotated[list[Number], Field(min_length=1)]], Field(min_length=1)] | (
        None
    ) = None
    """Linear map from a group to a group: a row for each input, a number for each output, in the
    order in which their FMUs name them.
    """
    add: bool = False
    """Whether several connections lead to this input, whose value is their sum."""
    policy: Policy = "hold"
    """The value of the input during a step: that at its beginning ("hold"), that at its middle,
    known from a transport delay ("midpoint") or extrapolated ("linear"), or that of one
    communication point before ("previous"), which cuts an algebraic loop.
    """
    _path: KeyPath | None = PrivateAttr(default=None)

    @property
    def path(self) -> KeyPath | None:
        """The path in the scenario of what it was made of; None: it stands there itself."""
        return self._path

    def made_of(self, path: KeyPath) -> Self:
        """Return the connection as made of the part of the scenario at a path."""
        made = self.model_copy()
        made._path = path  # noqa: SLF001 - of this class
        return made

    @model_validator(mode="after")
    def _one_map(self) -> Self:
        if self.matrix is not None:
            if self.gain is not None or self.offset is not None or self.add:
                raise ValueError("matrix without gain, offset and add")
            if len({len(row) for row in self.matrix}) > 1:
                raise ValueError("the rows of matrix must be of one length")
        return self


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
    return value_in(value, TIME) if isinstance(value, str) else value


class PathPart(Part):
    """[reference]: a path through points, for inputs that follow it."""

    target: Reference
    """Component and group of the inputs that follow the path."""
    axes: Annotated[list[str], Field(min_length=1)]
    """Names of these inputs in the group; "[1]" is the first element of an array."""
    points: Annotated[list[list[SignalValue]], Field(min_length=1)]
    """Rows of a time and one value per axis; the times increase. Before the first and after the
    last point the path is constant.
    """
    interpolation: Literal["smooth", "linear"] = "smooth"
    """Between two points the path is a straight line, with a speed that starts and ends at zero
    ("smooth") or is constant ("linear").
    """

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


PathOrPaths = Annotated[
    Annotated[PathPart, Tag("one")]
    | Annotated[list[PathPart], Field(min_length=1), Tag("several")],
    Discriminator(lambda value: "several" if isinstance(value, list) else "one"),
]


class DisturbancePart(Part):
    """[disturbance]: the worst-case disturbance of the scenario's design."""

    kind: Literal["worst-case"]
    """A "worst-case" one: the sinusoid that the nominal loop of the design amplifies most, with the
    envelope sin(pi t / end).
    """
    target: Reference
    """Component and group of the inputs, one per entry of w in Eq. (7)."""
    amplitude: Positive
    """Bound on |w|."""
    omega: Frequency | None = None
    """Frequency [rad/s]; without it that of the peak of the nominal loop. At zero the disturbance
    is constant; a peak at infinite frequency is refused.
    """


class EnvelopePart(Part):
    """Largest |u|, |v|, |w| [m/s], |r| [rad/s] and |psi| [rad] that the design allows for."""

    u: Speed
    """Largest |u|, speed ahead [m/s]."""
    v: Speed
    """Largest |v|, speed to starboard [m/s]."""
    w: Speed
    """Largest |w|, speed down [m/s]."""
    r: Rate
    """Largest |r|, rate of turn [rad/s]."""
    psi: Angle
    """Largest |psi|, deviation of the heading [rad]."""


MADE_WITH = ("gain", "order", "k1", "k2")
"""Keys of [design] that say how a design is made, not for which system."""


class DesignPart(Part):
    """[design]: the gain of the controller, and the system for which it is proved.

    Without `file` the gain of least gamma is designed, or `gain` is analysed.
    """

    model_config = ConfigDict(
        json_schema_extra={"anyOf": [{"required": ["system"]}, {"required": ["file"]}]}
    )
    system: Text | None = None
    """System that the gain is proved for: `paper`, `auv`, or a system file. With `file` it must be
    the system of that design.
    """
    file: Text | None = None
    """Design to use: a `.json` that `cosim design --save` wrote, a `.fmu` that `cosim fmu
    controller` made of one, or the name of a built-in design. Its proof is checked before the run,
    no solver runs, and other keys about the system must agree with it.
    """
    controller: Name = "controller"
    """Component that gets the gain."""
    plant: Name = "plant"
    """Component that the system describes."""
    gain: list[list[Number]] | None = None
    """Gain to analyse instead of a design: rows of numbers, one row per input."""
    k1: list[Number] | None = None
    """Free scalars k1 of Theorem 2, one per delay; without them they are searched."""
    k2: list[Number] | None = None
    """Free scalars k2 of Theorem 2, one per delay, not zero; without them they are searched."""
    order: Annotated[int, Field(ge=0, le=12)] | None = None
    """Order of the Bessel-Legendre inequality that improves the gain of Theorem 2."""
    state_delay: Delay | None = None
    """Delay inside the vehicle that the design is made for, in place of the plant's; `auv` only."""
    loop_delay: Delay | None = None
    """Greatest age of the feedback that the design is made for, in place of that of the system."""
    least_age: Delay | None = None
    """Least age of the feedback; without it a design made here is proved for what the links
    justify.
    """
    rate: NotNegative | None = None
    """Bound on the rate at which the age of the feedback changes; the age is then continuous."""
    sampled: bool | None = None
    """The age of the feedback is `least_age`, growing at rate one until the next sample is used."""
    outages: bool | None = None
    """Also prove what holds across outages of the link, for a design that is made here; the proof
    of a `file` has it, or not.
    """
    damping: Annotated[list[PerSecond], Field(min_length=4, max_length=4)] | None = None
    """Linear damping of the vehicle along u, v, w and r that the design is made for [1/s], in place
    of the plant's; of `auv` only.
    """
    position_weight: Positive | None = None
    """Weight of the positions in z; of `auv` only."""
    envelope: EnvelopePart | None = None
    """Bounds on the state inside which the uncertainty covers the vehicle's nonlinearity; of `auv`
    only.
    """

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
    """[log.components.NAME]: which log messages of one component are recorded."""

    level: Level | None = None
    """Lowest level of this component's messages that is recorded."""
    categories: list[str] | None = None
    """Log categories of the FMU to record; a status above Warning is always recorded."""


class LogPart(Part):
    """[log]: lowest level at which messages of components and master are recorded."""

    level: Level = "debug"
    """Lowest level at which messages of components and of the master are recorded."""
    components: dict[Name, ComponentLogPart] = Field(default_factory=dict)
    """Settings of single components, by name."""


class ScenarioPart(Part):
    """A whole scenario."""

    lists_faults: ClassVar[str | None] = "cosim scenario check"
    described_by: ClassVar[str | None] = "cosim scenario schema"

    title: Text = "A scenario"
    """One line that says what is run."""
    description: str = ""
    """What a reader should know: why these numbers."""
    run: RunPart
    """End, step, algorithm and seed."""
    components: Annotated[dict[Name, ComponentPart], Field(min_length=1)]
    """The FMUs of the run, by name."""
    connections: list[ConnectionPart] = Field(default_factory=list)
    """Which output goes to which input."""
    connect: list[Connect] = Field(default_factory=list)
    """Connections in their short form: "plant.eta -> controller.eta : uplink"."""
    links: dict[Name, LinkPart] = Field(default_factory=dict)
    """Links that connections name: delay, jitter, loss."""
    medium: dict[Name, MediumPart] = Field(default_factory=dict)
    """Media that links share: nodes, sound, collisions, slots."""
    computed: dict[Name, ComputedPart] = Field(default_factory=dict)
    """Values computed from signals, by name: [computed.error] with depth = "..." is a component
    `error` with the output `error.depth`.
    """
    sensors: dict[Name, SensorPart] = Field(default_factory=dict)
    """Sensors that connections name: noise, bias, drift, steps, range, freezing, sample time."""
    inputs: list[InputsPart] = Field(default_factory=list)
    """Time series that inputs follow."""
    reference: PathOrPaths | None = None
    """A path for inputs that follow it; several as [[reference]]."""
    disturbance: DisturbancePart | None = None
    """The worst-case disturbance of the design."""
    design: DesignPart | None = None
    """The gain of the controller, and the system it is proved for."""
    modes: dict[Name, ModesPart] = Field(default_factory=dict)
    """Mode machines: phases of a mission, what leads from one to another, and what is done then."""
    events: list[EventPart] = Field(default_factory=list)
    """What happens during the run."""
    assertions: list[AssertionPart] = Field(default_factory=list)
    """What must hold; the exit code is 1 where it does not."""
    log: LogPart | None = None
    """Which log messages are recorded."""
    limits: LimitsPart | None = None
    """Time and memory that a supervised run may use."""

    @model_validator(mode="before")
    @classmethod
    def _written_out(cls, data: Any) -> Any:
        return written_out(data)[0] if isinstance(data, dict) else data

    def to_data(self) -> dict[str, Any]:
        """Return the tables of the scenario, without defaults."""
        return self.model_dump(by_alias=True, exclude_unset=True, exclude_none=True)

    def to_toml(self) -> str:
        """Return TOML text that reads back as this scenario."""
        return tomli_w.dumps(self.to_data(), multiline_strings="\r" not in self.description)

    def paths(self) -> list[tuple[tuple[str | int, ...], PathPart]]:
        """Return the paths that inputs follow, each with its path in the scenario."""
        if isinstance(self.reference, list):
            return [(("reference", i), part) for i, part in enumerate(self.reference)]
        return [] if self.reference is None else [(("reference",), self.reference)]

    def wires(self) -> list[tuple[KeyPath, ConnectionPart]]:
        """Return the connections of both forms, each with the path of what it was made of."""
        long = enumerate(self.connections)
        found = [(part.path or ("connections", i), part) for i, part in long]
        return found + [(("connect", i), connection_of(x)) for i, x in enumerate(self.connect)]
