"""A study as data: the scenario, the axes that vary it, the metrics, the traces to keep."""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import (
    ConfigDict,
    Field,
    StringConstraints,
    field_validator,
    model_validator,
)

from cosim.core import SCHEMA, STUDY_FILE, InputError, Number, Text
from cosim.scenario import COLUMN_PATTERN, BoundExpression, ExpressionError, Part, formula, split

ColumnName = Annotated[str, StringConstraints(pattern=COLUMN_PATTERN)]
Integer = Annotated[int, Field(ge=-(2**53), le=2**53)]
Seed = Annotated[int, Field(ge=0, lt=2**31)]
MAX_RUNS = 10_000_000
"""Most runs, and samples, of a study."""

_TRACES = re.compile(r"^(none|all|failed|worst:(?P<n>[1-9][0-9]{0,5}) by (?P<by>-?\S.*))$")
RESERVED = ("run", "status", "reason")
"""Columns that every table of results has."""


def of_x(text: str) -> BoundExpression:
    """Return the number that a text says of x; an `InputError` where it says none."""
    return formula(text, "x")


class Axis(Part):
    """The places of the scenario that one axis changes.

    Exactly one of `path`, `paths` and `apply`.
    """

    name: ColumnName | None = None
    """Column in the table of results; without it the first place that is changed."""
    path: Text | None = None
    """Place of the scenario to change, as in `links.uplink.loss`."""
    paths: Annotated[list[Text], Field(min_length=1)] | None = None
    """Several places that get the same value, or one value each of `rows`."""
    apply: Annotated[dict[Text, Text], Field(min_length=1)] | None = None
    """Several places, each with an expression of `x`, the value of the axis."""

    @model_validator(mode="after")
    def _one_target(self) -> Self:
        _exactly_one(self, ("path", "paths", "apply"), "names the places to change")
        for place in self.places:
            _check(split, place)
        for expression in (self.apply or {}).values():
            _check(of_x, expression)
        return self

    @property
    def places(self) -> tuple[str, ...]:
        """The dotted paths that the axis sets."""
        if self.path is not None:
            return (self.path,)
        return tuple(self.paths or self.apply or ())

    @property
    def column(self) -> str:
        """The name of the axis in the table of results."""
        return self.name or self.places[0]


class GridAxis(Axis):
    """Given values, each combined with all values of the other axes."""

    kind: Literal["grid"]
    """Given values, each combined with all values of the other axes."""
    values: Annotated[list[Any], Field(min_length=1)] | None = None
    """Any values of a scenario: numbers, strings, tables, a matrix."""
    rows: Annotated[list[list[Any]], Field(min_length=1)] | None = None
    """One value per entry of `paths` in each row."""
    linspace: Annotated[list[Number], Field(min_length=3, max_length=3)] | None = None
    """[first, last, count], evenly spaced."""
    logspace: Annotated[list[Number], Field(min_length=3, max_length=3)] | None = None
    """[first, last, count], with even ratios."""

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        _exactly_one(self, ("values", "rows", "linspace", "logspace"), "gives the values")
        for key in ("linspace", "logspace"):
            spaced = getattr(self, key)
            if spaced is not None and (spaced[2] != int(spaced[2]) or spaced[2] < 1):
                raise ValueError(f"{key} is [first, last, count] with a whole count; got {spaced}")
        if self.logspace is not None and min(self.logspace[:2]) <= 0:
            raise ValueError(f"logspace runs between positive numbers; got {self.logspace[:2]}")
        if self.rows is not None:
            wanted = len(self.paths or ())
            if any(len(row) != wanted for row in self.rows):
                raise ValueError(f"rows have one value per entry of paths: {wanted}")
        return self


Parameter = Number | Text
"""A number, or an expression of x."""
_CONDITIONAL = ("uniform", "loguniform", "normal", "lognormal", "triangular")


class SampledAxis(Axis):
    """Random values; all axes of this kind together give the study's `samples` points."""

    kind: Literal["random", "sobol", "latin", "saltelli"]
    """How they are drawn. "random": independent draws; "sobol": points of a scrambled Sobol
    sequence, one dimension per such axis; "latin": a Latin hypercube, one point in each of
    `samples` intervals of equal probability; "saltelli": for sensitivity indices, samples times
    (number of such axes + 2) points, with no other kind beside it.
    """
    uniform: Annotated[list[Parameter], Field(min_length=2, max_length=2)] | None = None
    """[low, high]."""
    loguniform: Annotated[list[Parameter], Field(min_length=2, max_length=2)] | None = None
    """[low, high]: the logarithm is uniform."""
    normal: Annotated[list[Parameter], Field(min_length=2, max_length=2)] | None = None
    """[mean, standard deviation]."""
    lognormal: Annotated[list[Parameter], Field(min_length=2, max_length=2)] | None = None
    """[median, standard deviation of the natural logarithm]."""
    triangular: Annotated[list[Parameter], Field(min_length=3, max_length=3)] | None = None
    """[low, most likely, high]."""
    empirical: Annotated[list[Number], Field(min_length=2)] | None = None
    """Measured values: their quantiles, linear in between."""
    integers: Annotated[list[Integer], Field(min_length=2, max_length=2)] | None = None
    """[low, high], both included."""
    choice: Annotated[list[Any], Field(min_length=1)] | None = None
    """Values with equal probability, or by `weights`."""
    weights: Annotated[list[Annotated[Number, Field(gt=0)]], Field(min_length=1)] | None = None
    """Relative probability of each value of `choice`."""
    given: Text | None = None
    """Name of an earlier sampled axis: parameters of the distribution may be expressions of x, its
    value at the same point, as in normal = ["4 * sqrt(x)", 0.3].
    """

    @model_validator(mode="after")
    def _one_distribution(self) -> Self:
        keys = ("uniform", "loguniform", "normal", "lognormal", "triangular", "empirical")
        _exactly_one(self, (*keys, "integers", "choice"), "gives the distribution")
        texts = [v for key in keys for v in getattr(self, key) or () if isinstance(v, str)]
        for text in texts:
            _check(of_x, text)
        if bool(texts) != (self.given is not None):
            raise ValueError("expressions of x and given, which names the axis x, need each other")
        if not texts:
            self.check_numbers()
        return self

    def check_numbers(self) -> None:
        """Check the numbers of the distribution.

        Raises
        ------
        ValueError : they are none of a distribution.
        """
        given: Any = self  # expressions have become numbers
        for key in ("uniform", "loguniform", "integers", "triangular"):
            bounds = getattr(given, key)
            if bounds is not None and any(b < a for a, b in pairwise(bounds)):
                words = "[low, most likely, high]" if key == "triangular" else "[low, high]"
                raise ValueError(f"{key} is {words}; got {bounds}")
        if given.lognormal is not None and (given.lognormal[0] <= 0 or given.lognormal[1] < 0):
            raise ValueError(f"lognormal is [median > 0, deviation >= 0]; got {self.lognormal}")
        if self.weights is not None and len(self.weights) != len(self.choice or ()):
            raise ValueError(f"weights has one number for each value of choice; got {self.weights}")
        if given.loguniform is not None and given.loguniform[0] <= 0:
            raise ValueError(f"loguniform runs between positive numbers; got {self.loguniform}")
        if given.normal is not None and given.normal[1] < 0:
            raise ValueError(f"normal is [mean, standard deviation >= 0]; got {self.normal}")

    def at(self, x: Any) -> SampledAxis:
        """Return the axis with the values of its expressions at x, that of the axis `given`.

        Raises
        ------
        InputError : an expression has no value at x, or they are no parameters of the distribution.
        """
        key = next(key for key in _CONDITIONAL if getattr(self, key) is not None)
        values = [of_x(v).number(x=x) if isinstance(v, str) else v for v in getattr(self, key)]
        found = self.model_copy(update={key: values, "given": None})
        try:
            found.check_numbers()
        except ValueError as error:
            raise InputError(
                "a distribution has no such parameters",
                where=self.column,
                expected=str(error),
                got=f"{self.given} = {x!r}",
            ) from error
        return found


class ReplicatesAxis(Axis):
    """The same run with `count` different seeds: first, first + 1, ..."""

    kind: Literal["replicates"]
    """The same run with other seeds."""
    path: Text | None = None
    """Seed to change; without any place that of the run."""
    count: Annotated[int, Field(ge=1, le=MAX_RUNS)]
    """Number of seeds."""
    first: Seed = 1
    """First seed; the others follow it."""

    @model_validator(mode="before")
    @classmethod
    def _seed_of_the_run(cls, data: Any) -> Any:
        if isinstance(data, dict) and not {"path", "paths", "apply"} & set(data):
            return {**data, "path": "run.seed"}
        return data


AnyAxis = Annotated[GridAxis | SampledAxis | ReplicatesAxis, Field(discriminator="kind")]

Reduction = Literal[
    "max_abs", "rms", "mean", "minimum", "maximum", "final", "settling_time", "growth_rate"
]


class Metric(Part):
    """One figure of a run: a `path` into the output of `cosim run --json`, or a reduced signal.

    Or a `value` that is computed from figures before it.
    """

    path: Text | None = None
    """Figure of the output of `cosim run --json`: "status", "metrics.gain", "final.plant.eta.x",
    "links.uplink.max_age_s".
    """
    signal: Text | Annotated[list[Text], Field(min_length=1)] | None = None
    """`component.variable`, or several, of which the Euclidean norm is taken."""
    value: Text | None = None
    """Expression of the names of metrics before this one, as in "error / wander"."""
    reduce: Reduction | None = None
    """How the signal, less `to`, becomes one number; settling_time and growth_rate in s and 1/s."""
    after: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    """Time from which the signal counts [s]."""
    to: Number = 0.0
    """Value that the signal is compared with."""
    within: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    """For settling_time: the band |signal - to| <= within."""
    below: Number | None = None
    """The metric is whether the figure is below this; false if there is none."""
    above: Number | None = None
    """The metric is whether the figure is above this; false if there is none."""
    equals: str | bool | Number | None = None
    """The metric is whether the figure equals this; false if there is none."""

    @model_validator(mode="before")
    @classmethod
    def _short(cls, data: Any) -> Any:
        return {"path": data} if isinstance(data, str) else data

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if [self.path, self.signal, self.value].count(None) != 2:
            raise ValueError("a metric has either a path or a signal, or else a value")
        if (self.signal is None) != (self.reduce is None):
            raise ValueError("signal and reduce belong together")
        if (self.within is None) != (self.reduce != "settling_time"):
            raise ValueError("within is the band of reduce = 'settling_time' and is required there")
        if self.path is not None:
            _check(split, self.path)
        if self.signal is None and (self.after or self.to):
            raise ValueError("after and to belong to a signal")
        return self

    @property
    def asks(self) -> bool:
        """Whether the metric is true or false."""
        return any(bound is not None for bound in (self.below, self.above, self.equals))

    @property
    def signals(self) -> tuple[str, ...]:
        """The signals that the metric is computed from."""
        return (self.signal,) if isinstance(self.signal, str) else tuple(self.signal or ())


class Correlation(Part):
    """Two sampled axes that are correlated, by a Gaussian copula."""

    axes: Annotated[list[Text], Field(min_length=2, max_length=2)]
    """Names of two sampled axes."""
    value: Annotated[float, Field(gt=-1, lt=1)]
    """Correlation of the normal values behind them: of two normal axes it is their own."""

    @model_validator(mode="after")
    def _two_axes(self) -> Self:
        if self.axes[0] == self.axes[1]:
            raise ValueError(f"two axes; got {self.axes[0]} twice")
        return self


class StabilityPart(Part):
    """[stability]: what `cosim study show --picture` draws for a study of delay (and loss)."""

    delay: Text
    """Axis of the delay of the whole loop [s]."""
    stable: Text
    """Metric that says whether a run is stable."""
    loss: Text | None = None
    """Axis of the loss."""
    gain: Text | None = None
    """Metric to colour the picture with."""
    certified: Text | None = None
    """Metric `metrics.guarantee_claimed`: whether the run met all that its certificate assumes."""


class StopPart(Part):
    """stop: end the study when the interval of a metric is narrow enough."""

    metric: Text
    """Metric of which the share (true or false) or the mean (a number) is wanted."""
    width: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    """Width of the interval, from end to end, at which the study ends."""
    confidence: Annotated[float, Field(ge=0.5, lt=1)] = 0.95
    """Confidence level of the interval at the end, over all looks together."""
    first: Annotated[int, Field(ge=10, le=MAX_RUNS)] = 50
    """Number of runs before the first look; each later one has 1.3 times as many."""


class RarePart(Part):
    """rare: estimate the small probability that a metric is beyond a bound."""

    metric: Text
    """Metric, a number."""
    above: Number | None = None
    """The event is that the metric is above this."""
    below: Number | None = None
    """The event is that the metric is below this."""
    method: Literal["subset", "importance"] = "subset"
    """"subset": level by level, each of a tenth of the probability; "importance": one sample
    about the points where a pilot, of such levels, found the event.
    """
    levels: Annotated[int, Field(ge=2, le=30)] = 12
    """Most levels: the probability is not followed below about a tenth to this power."""
    pilot: Annotated[int, Field(ge=100, le=MAX_RUNS)] | None = None
    """For importance: runs per level of the pilot; without it, the study's samples."""
    missing: Literal["refuse", "beyond", "within"] = "refuse"
    """How a run counts that has no value of the metric, as one that crashed."""

    @model_validator(mode="after")
    def _one_bound(self) -> Self:
        _exactly_one(self, ("above", "below"), "gives the bound")
        if self.pilot is not None and self.method != "importance":
            raise ValueError("pilot belongs to method = 'importance'")
        return self

    def beyond(self, value: float) -> float:
        """Return by how much a value is beyond the bound; negative within it."""
        return value - self.above if self.above is not None else (self.below or 0.0) - value


class Study(Part):
    """A whole study.

        >>> from cosim.study import Study
        >>> study = Study(
        ...     title="How often a sample must be taken",
        ...     scenario="paper-example",
        ...     vary=[{"kind": "grid", "path": "run.step", "values": [0.01, 0.02]}],
        ...     metrics={"gain": "metrics.gain", "claimed": "metrics.guarantee_claimed"},
        ... )
        >>> study.vary[0].column, list(study.metrics), study.traces
        ('run.step', ['gain', 'claimed'], 'none')

    `run_study` runs it. The keys are those of a study's TOML (Reference, Studies).
    """

    described_by: ClassVar[str | None] = "cosim study schema"

    model_config = ConfigDict(json_schema_extra={"description": "A whole study."})

    title: Text
    """One line that says what is studied."""
    description: str = ""
    """What a reader should know: why these axes."""
    scenario: Text
    """Scenario that is varied: a built-in name, or a path from the study's folder."""
    set: dict[str, Any] = Field(default_factory=dict)
    """Changes to the scenario in every run, by dotted path."""
    vary: Annotated[list[AnyAxis], Field(min_length=1)]
    """The axes: what varies from run to run."""
    metrics: Annotated[dict[ColumnName, Metric], Field(min_length=1)]
    """Figures to keep of every run, by the name of their column."""
    samples: Annotated[int, Field(ge=1, le=MAX_RUNS)] = 1
    """Number of points of all sampled axes together."""
    seed: Seed = 1
    """Seed of their draws."""
    correlations: list[Correlation] = Field(default_factory=list)
    """Sampled axes that are not independent."""
    traces: str = "none"
    """Runs whose traces are kept: none, all, failed, or worst:N by METRIC (by -METRIC: the
    smallest).
    """
    stability: StabilityPart | None = None
    """What `cosim study show --picture` draws of a study of delay and loss."""
    stop: StopPart | None = None
    """When to end before all samples or replicates are done; for axes of kind random, or
    replicates, alone.
    """
    rare: RarePart | None = None
    """A rare event, whose probability is estimated; `samples` runs per level, axes of kind random
    alone.
    """

    @field_validator("traces")
    @classmethod
    def _known(cls, value: str) -> str:
        if not _TRACES.match(value):
            raise ValueError("none, all, failed, or worst:N by METRIC (by -METRIC: the smallest)")
        return value

    @field_validator("metrics")
    @classmethod
    def _values(cls, metrics: dict[str, Metric]) -> dict[str, Metric]:
        for i, (name, metric) in enumerate(metrics.items()):
            if metric.value is not None:
                try:
                    formula(metric.value, *[*metrics][:i])
                except ExpressionError as error:
                    raise ValueError(
                        f"metrics before it; {name}, {error.where}: {error.what} ({error.expected})"
                    ) from error
        return metrics

    @field_validator("set")
    @classmethod
    def _paths(cls, value: dict[str, Any]) -> dict[str, Any]:
        for path in value:
            _check(split, path)
        return value

    @property
    def worst(self) -> tuple[int, str] | None:
        """Number of the worst runs whose traces are kept, and the metric that ranks them."""
        match = _TRACES.match(self.traces)
        return (int(match["n"]), match["by"]) if match and match["n"] else None


def _exactly_one(part: Part, keys: tuple[str, ...], purpose: str) -> None:
    given = [key for key in keys if getattr(part, key) is not None]
    if len(given) != 1:
        got = " and ".join(given) or "none"
        raise ValueError(f"exactly one of {', '.join(keys)} {purpose}; got {got}")


def _check(parse: Callable[[str], Any], text: str) -> None:
    try:
        parse(text)
    except InputError as error:
        found, what = error.got, error.what
        if isinstance(error, ExpressionError):
            found, what = repr(text), f"{error.where}: {error.what}"
        raise ValueError(f"{what}: {found}; expected {error.expected}") from error


def study_schema() -> dict[str, Any]:
    """Return the JSON Schema of a study file, for editors."""
    whole = Study.model_json_schema()
    whole["properties"] = {SCHEMA: STUDY_FILE.json_schema(), **whole["properties"]}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **whole}
