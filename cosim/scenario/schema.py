"""A scenario as data: what flies, over which links, for how long, with which gain.

Times are in seconds, angles in radian, everything else in the SI unit of its variable.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, model_validator

NAME_PATTERN = r"^[A-Za-z][A-Za-z0-9_-]*$"
REFERENCE_PATTERN = r"^[A-Za-z][A-Za-z0-9_-]*\..+$"
Name = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]
Reference = Annotated[str, StringConstraints(pattern=REFERENCE_PATTERN)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
# three years: sums of a few such times still fit into 64-bit nanoseconds
Duration = Annotated[float, Field(gt=0, le=1e8, allow_inf_nan=False)]
Delay = Annotated[float, Field(ge=0, le=1e8, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]


class _Part(BaseModel):
    # strict: "5.0" is no number and true is no 1, as TOML itself has it
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True, strict=True)


class RunPart(_Part):
    """[run]: when, and with which luck."""

    end: Duration
    step: Duration
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    events: Literal["align", "grid"] = "align"
    divergence: Positive = 1e6


class ComponentPart(_Part):
    """[components.NAME]: an FMU of the catalogue by name, or any `.fmu` path."""

    fmu: Annotated[str, StringConstraints(min_length=1)]
    parameters: dict[str, Number | bool] = {}


class JitterPart(_Part):
    """Extra delay of each message, never negative."""

    kind: Literal["uniform", "exponential", "normal"]
    width: Delay = 0.0
    mean: Delay = 0.0
    sigma: Delay = 0.0
    max: Duration | None = None


class BurstPart(_Part):
    """Gilbert-Elliott loss."""

    p_enter: Probability
    p_exit: Probability
    loss_good: Probability = 0.0
    loss_bad: Probability = 1.0


class PacketPart(_Part):
    """[links.NAME] with kind = "packet"."""

    kind: Literal["packet"]
    sample_time: Duration
    offset: Delay = 0.0
    delay: Delay = 0.0
    jitter: JitterPart | None = None
    loss: Probability | BurstPart = 0.0
    order: Literal["newest-wins", "fifo", "as-arrived"] = "newest-wins"
    on_loss: Literal["hold", "zero"] | Number = "hold"
    quantization: NotNegative = 0.0
    data_rate: Annotated[int, Field(ge=0)] = 0
    frame_size: Annotated[int, Field(ge=0)] = 0
    seed: Annotated[int, Field(ge=0, lt=2**31)] | None = None


class TransportPart(_Part):
    """[links.NAME] with kind = "transport"."""

    kind: Literal["transport"]
    delay: Delay


LinkPart = Annotated[PacketPart | TransportPart, Field(discriminator="kind")]


class ConnectionPart(_Part):
    """[[connections]]: `from = "plant.eta"` stands for every variable `eta.*` or `eta[...]`."""

    source: Reference = Field(alias="from")
    target: Reference = Field(alias="to")
    link: Name | None = None


class PathPart(_Part):
    """[reference]: a path through points, for inputs that follow it.

    `points` are rows of time and one value per axis; between two of them the path is a
    straight line, run with a speed that starts and ends at rest ("smooth") or is constant
    ("linear"); before the first and after the last it stands still.
    """

    target: Reference
    axes: Annotated[list[str], Field(min_length=1)]
    points: Annotated[list[list[Number]], Field(min_length=1)]
    interpolation: Literal["smooth", "linear"] = "smooth"

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


class DisturbancePart(_Part):
    """[disturbance]: what the design of the same scenario withstands least.

    "worst-case": the sinusoid that the nominal closed loop amplifies most, at the frequency of
    its peak or at `omega` [rad/s], |w| at most `amplitude`, swelling and fading as
    sin(pi t / end). At frequency zero that is a constant push; a peak at infinite frequency is
    attained by no disturbance and refused. `target` is a group of inputs, one per entry of w
    in Eq. (7).
    """

    kind: Literal["worst-case"]
    target: Reference
    amplitude: Positive
    omega: NotNegative | None = None


class EnvelopePart(_Part):
    """Largest |u|, |v|, |w| [m/s], |r| [rad/s] and |psi| [rad] that the design allows for."""

    u: Positive
    v: Positive
    w: Positive
    r: Positive
    psi: Positive


class DesignPart(_Part):
    """[design]: which gain flies, and for what it is proved.

    Without `gain` the least-gamma gain is designed; with it, that gain is analysed.
    """

    system: Annotated[str, StringConstraints(min_length=1)]
    controller: Name = "controller"
    plant: Name = "plant"
    gain: list[list[Number]] | None = None
    k1: list[Number] | None = None
    k2: list[Number] | None = None
    order: Annotated[int, Field(ge=0, le=12)] | None = None
    state_delay: NotNegative | None = None
    loop_delay: NotNegative | None = None
    damping: Annotated[list[NotNegative], Field(min_length=4, max_length=4)] | None = None
    position_weight: Positive | None = None
    envelope: EnvelopePart | None = None

    @model_validator(mode="after")
    def _rows(self) -> Self:
        lengths = sorted({len(row) for row in self.gain or ()})
        if len(lengths) > 1:
            raise ValueError(
                f"the rows of gain must be of one length; got {' and '.join(map(str, lengths))}"
            )
        return self


class Scenario(_Part):
    """A whole scenario."""

    title: Annotated[str, StringConstraints(min_length=1)]
    description: str = ""
    run: RunPart
    components: Annotated[dict[Name, ComponentPart], Field(min_length=1)]
    connections: list[ConnectionPart] = []
    links: dict[Name, LinkPart] = {}
    reference: PathPart | None = None
    disturbance: DisturbancePart | None = None
    design: DesignPart | None = None
