"""[computed.NAME], [sensors.NAME] and [[inputs]]: signals that no FMU of the scenario sends."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, StringConstraints, field_validator, model_validator

from cosim.core import Number, Text
from cosim.scenario.binding import AnyName, bind
from cosim.scenario.expression import Expression
from cosim.scenario.fields import (
    OUTPUT_PATTERN,
    Delay,
    Instant,
    Part,
    Reference,
    Seconds,
    SignalValue,
)

OutputName = Annotated[str, StringConstraints(pattern=OUTPUT_PATTERN)]


def _expression(text: str) -> str:
    bind(Expression(text), AnyName(), None)
    return text


ExpressionText = Annotated[str, AfterValidator(_expression)]
"""A number or a truth value in the expression language."""
ComputedPart = Annotated[dict[OutputName, ExpressionText], Field(min_length=1)]
"""[computed.NAME]: values by name, each an expression of signals and of the time t."""
Setting = SignalValue | dict[Text, SignalValue]
"""One value for all that a sensor measures, or by the name of each."""


class FreezePart(Part):
    """A time in which a sensor keeps its values."""

    start: Instant = Field(alias="from")
    """From then on."""
    until: Instant | None = None
    """Until then; without it to the end of the run."""

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.until is not None and self.until <= self.start:
            raise ValueError(f"until after from; got {self.start:g} and {self.until:g} s")
        return self


class SensorPart(Part):
    """[sensors.NAME]: what is wrong with the values of the connections that name it.

    Each setting is one for all values, or a table by the name of the value: `"eta.x" = "0.5 m"`.
    """

    noise: Setting = 0.0
    """Size of the noise: standard deviation of a normal one, half the width of a uniform one."""
    distribution: Literal["normal", "uniform"] = "normal"
    """Distribution of the noise."""
    bias: Setting = 0.0
    """Constant error."""
    drift: Setting = 0.0
    """Growth of the error per second."""
    resolution: Setting = 0.0
    """Steps in which it shows values, rounded to the nearest; 0: none."""
    least: Setting | None = None
    """Least value that it shows."""
    greatest: Setting | None = None
    """Greatest value that it shows."""
    sample_time: Delay = 0.0
    """Time between samples, held in between; 0: a sample at every communication point."""
    freeze: FreezePart | None = None
    """A time in which it keeps its values; events set NAME.frozen to 1."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] | None = None
    """Seed of the noise; without it that of the run."""

    @field_validator("noise", "resolution")
    @classmethod
    def _not_negative(cls, value: Setting) -> Setting:
        for one in value.values() if isinstance(value, dict) else (value,):
            if (isinstance(one, str) and one.lstrip().startswith("-")) or (
                not isinstance(one, str) and one < 0
            ):
                raise ValueError(f"0 or more; got {one!r}")
        return value


class InputsPart(Part):
    """[[inputs]]: a time series that inputs follow, from a file or from lists."""

    file: Text | None = None
    """CSV or Parquet file, from the folder of the scenario."""
    time: Text = "time"
    """Column of the times, in seconds, which increase."""
    columns: Annotated[dict[Reference, Text], Field(min_length=1)] | None = None
    """Column of the file that each input follows, by `component.variable`."""
    times: Annotated[list[Seconds], Field(min_length=1)] | None = None
    """Times, in place of a file; they increase."""
    values: Annotated[dict[Reference, list[Number]], Field(min_length=1)] | None = None
    """Values of each input at these times."""
    units: dict[Reference, Text] = Field(default_factory=dict)
    """Units of the values of inputs; without one they are in the unit of the input."""
    interpolation: Literal["linear", "hold"] = "linear"
    """Between two times: on a line ("linear"), or the value before ("hold")."""
    beyond: Literal["hold", "zero", "repeat", "refuse"] = "hold"
    """Before the first and after the last time: the nearest value ("hold"), "zero", the series
    again and again ("repeat", the last row being the first one of the next turn), or a run that
    goes there is refused ("refuse").
    """

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        of_file = (self.file, self.columns)
        of_lists = (self.times, self.values)
        if not (
            (all(x is not None for x in of_file) and of_lists == (None, None))
            or (of_file == (None, None) and all(x is not None for x in of_lists))
        ):
            raise ValueError("either file and columns, or times and values")
        if self.times is not None and any(b <= a for a, b in pairwise(self.times)):
            raise ValueError("the times must increase")
        for name, column in (self.values or {}).items():
            if len(column) != len(self.times or ()):
                raise ValueError(
                    f"one value of {name} for each time; got {len(column)} for "
                    f"{len(self.times or ())}"
                )
        known = [*(self.columns or self.values or ())]
        stray = next((name for name in self.units if name not in known), None)
        if stray is not None:
            raise ValueError(f"units of inputs named here ({', '.join(known)}); got {stray}")
        if self.beyond == "repeat" and len(self.times or (0, 1)) < 2:
            raise ValueError("two times at least to repeat")
        return self
