"""The system file as data: every key with its unit and shape, in the symbols of Eq. (7)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Final, Self

from pydantic import AfterValidator, BeforeValidator, Field, PlainValidator, model_validator

from cosim.core import InputError, KeyPath, Part, format_value
from cosim.hinf.certificate import (
    DelayPart,
    Double,
    MaybeDouble,
    MaybeRows,
    MeasurementPart,
    Numbers,
    Rows,
    Seconds,
    SystemPart,
    matrix_from_rows,
    number,
)

OneOrMore = Annotated[
    Numbers,
    BeforeValidator(
        lambda value: value if isinstance(value, list) else [value],
        json_schema_input_type=float | list[float],
    ),
]
"""Numbers, of which one may stand without brackets."""


def _no_zero(values: tuple[float, ...]) -> tuple[float, ...]:
    if 0.0 in values:
        raise ValueError("no zero (Theorem 2)")
    return values


def _rows_or_states(value: Any) -> Any:
    if isinstance(value, list) and value and isinstance(value[0], list):
        return matrix_from_rows(value, "")
    if not isinstance(value, list):
        raise ValueError("a list, in brackets")  # noqa: TRY004 - pydantic's way
    return [number(x, f"[{i}]") for i, x in enumerate(value)]


class IntegralPart(Part):
    """[system.integral]: integral action on what the controller receives."""

    of: Annotated[
        Any, PlainValidator(_rows_or_states, json_schema_input_type=list[int] | list[list[float]])
    ]
    """States that are integrated, from 1, or rows of their combinations."""
    weights: Numbers | None = None
    """Of the integrals in z, > 0; without them 0.1/d times those of the states."""
    age: MaybeDouble = None
    """Greatest age of an integral where it acts [s]; 0: at once."""


class SystemTable(SystemPart):
    """[system]: matrices of Eq. (7); a matrix is a list of rows."""

    A1: MaybeRows = None
    """Of x(t-d), where there is one constant delay; n rows and columns."""
    H1: MaybeRows = None
    """Right factor of the uncertainty of A1, n columns."""
    d: Seconds | None = None
    """The one delay [s]; with A1 or H1."""
    delays: list[DelayPart] = Field(default_factory=list)
    """Any number of delays, [[system.delays]], in place of A1, H1, d."""
    weights: Numbers | None = None
    """One > 0 for each row of z, which is multiplied by it."""
    integral: IntegralPart | None = None
    """Integral action of the controller."""

    @model_validator(mode="after")
    def _one_spelling(self) -> Self:
        one = [key for key in ("d", "A1", "H1") if key in self.model_fields_set]
        if one and "delays" in self.model_fields_set:
            raise InputError(
                "one delay and a list of delays at once",
                expected="either d, A1, H1 or [[system.delays]]",
                got=f"{', '.join(one)} beside delays",
                hint="write d and A1 as a table [[system.delays]] too, with d and A",
            )
        if one and (one == ["d"] or "d" not in one):
            raise InputError(
                "half a delay",
                expected="d, and A1 or H1 (or both)",
                got=", ".join(one),
                hint="a delay of the feedback alone is a table [[system.delays]], with "
                f"d = {format_value(self.d or 0.3)}, feedback = true, any_age = true",
            )
        return self


class FilterPart(Part):
    """[weights.z], [weights.w]: a filter, as matrices or as transfer functions."""

    A: MaybeRows = None
    """x_f' = A x_f + B v, stable."""
    B: MaybeRows = None
    """Of the input v of the filter."""
    C: MaybeRows = None
    """The output is C x_f + D v."""
    D: MaybeRows = None
    """Of v in the output; without it zero."""
    numerators: list[Numbers] | None = None
    """In place of A, B, C, D: a transfer function for each entry, by falling powers of s."""
    denominators: list[Numbers] | None = None
    """One for each numerator."""

    @model_validator(mode="after")
    def _one_spelling(self) -> Self:
        given = self.model_fields_set
        if given - {"D"} != {"A", "B", "C"} and given != {"numerators", "denominators"}:
            raise InputError(
                "not a filter",
                expected="A, B, C and, where it is not zero, D; or numerators and denominators",
                got=", ".join(sorted(given)) or "nothing",
            )
        tops, bottoms = self.numerators or (), self.denominators or ()
        if len(tops) != len(bottoms):
            raise InputError(
                "numerators and denominators do not match",
                expected="one denominator per numerator",
                got=f"{len(tops)} and {len(bottoms)}",
            )
        return self


class FiltersPart(Part):
    """[weights]: weights that depend on frequency."""

    z: FilterPart | None = None
    """Of the output z."""
    w: FilterPart | None = None
    """Of the disturbance w."""


class DesignPart(Part):
    """[design]: settings and constraints of a design; none is needed."""

    k1: OneOrMore | None = None
    """Scalars k1 of Theorem 2, one per delay; else searched."""
    k2: Annotated[OneOrMore, AfterValidator(_no_zero)] | None = None
    """Scalars k2, one per delay, not zero; else searched."""
    gamma: Annotated[Double, Field(gt=0)] | None = None
    """Gain from w to z to be met, > 0; without it the least."""
    decay: MaybeDouble = None
    """Least rate at which every solution with w = 0 decays [1/s]."""
    damping: MaybeDouble = None
    """Least damping ratio of the nominal loop's roots s, from 0 to 1; with within."""
    within: MaybeDouble = None
    """Damping is for the roots with Re s >= -within [1/s]."""
    gain_limit: MaybeDouble = None
    """Bound on |K|, the largest singular value."""
    peak_control: OneOrMore | None = None
    """Bounds on every |u_i(t)|, for offset and energy; one, or one each."""
    offset: Numbers | None = None
    """Bounds on the initial state |x_i(0)|, constant before."""
    energy: MaybeDouble = None
    """Bound on the square root of the integral of w'w."""


class SensorPart(MeasurementPart):
    """[[measurements]]: a sensor.

    All states, whole, without noise, are fed back; else an observer is designed.
    """

    states: list[int] | None = None
    """The states it measures, from 1; or C."""
    C: MaybeRows = None
    """y = C x + v, in place of states; n columns."""
    any_age: bool = True
    """Every age from 0 to d, however it varies. False: the constant d, which nothing has that is
    held between messages.
    """

    @model_validator(mode="after")
    def _one_spelling(self) -> Self:
        if (self.C is None) == (self.states is None):
            raise InputError(
                "not what is measured",
                expected="either C, rows of numbers, or states, counted from 1",
                got="neither" if self.C is None else "both",
            )
        return self


class ObserverPart(Part):
    """[observer]: an observer of the measurements, also where none is needed."""

    known: list[int] | None = None
    """States, from 1, that only u and known states act on, as on a thruster's lag."""
    command_age: Seconds | None = None
    """Greatest age of a command, from the estimate to the end of its use: the longest hold and a
    step; 0: at once, which no run can show [s]. Without it the greatest of some ages, half the
    least of a measurement at most, that makes gamma less than a quarter greater.
    """
    command_any_age: bool = True
    """Every age from 0 to command_age. False: the constant one, which nothing has that is held
    between steps.
    """
    K: MaybeRows = None
    """u = K xh, where it is not to be designed; n columns."""
    L: dict[str, Rows] | None = None
    """L of every measurement by its name, where it is not to be designed."""
    offset: Numbers | None = None
    """Prove peaks of u and x from |x_i(0)| at most this, >= 0, one for each state."""
    initial_error: Numbers | None = None
    """Of the estimate, >= 0; without it that starts at zero, and the error is x."""
    energy: MaybeDouble = None
    """Of w and noise of these peaks: square root of the integral of w'w."""

    @model_validator(mode="after")
    def _peaks_from_a_state(self) -> Self:
        if self.offset is None and {"initial_error", "energy"} & self.model_fields_set:
            raise InputError(
                "peaks from no initial state", expected="offset, zeros where it is zero"
            )
        return self


_IN_SYSTEM: Final[Mapping[str, str]] = MappingProxyType(
    {
        **dict.fromkeys(("tau", "delay", "h"), "the delay is d, in seconds"),
        **dict.fromkeys(("Ad", "A_d"), "the matrix of the delayed state is A1"),
        "A2": "several delays are tables [[system.delays]], each with A and d",
        "Bu": "the matrix of the control u is B",
        "Bw": "the matrix of the disturbance w is C",
        "B1": "did you mean C, the matrix of the disturbance w, or B, that of the control u?",
        "B2": "did you mean B, the matrix of the control u, or C, that of the disturbance w?",
        "C1": "did you mean D, the matrix of the state in z?",
        "D11": "did you mean D1, the matrix of the disturbance in z?",
        "D12": "did you mean D2, the matrix of the control in z?",
        "K": "a gain is given to a command: cosim analyse FILE --gain '[[...]]'",
        "measurements": "a measurement is a table [[measurements]] of its own, beside [system]",
        "observer": "it is a table of its own, [observer], beside [system]",
    }
)
_AT_THE_TOP: Final[Mapping[str, str]] = MappingProxyType(
    {
        **dict.fromkeys(
            (*SystemTable.model_fields, *_IN_SYSTEM),
            "the matrices belong into a table: put the line [system] above them",
        ),
        "delays": "a delay is a table [[system.delays]]",
        "integral": "integral action is the table [system.integral]",
        "measurement": "a measurement is a table [[measurements]]",
        "sensors": "a sensor is a table [[measurements]]",
    }
)
_IN_DESIGN: Final[Mapping[str, str]] = MappingProxyType(
    {
        "weights": "weights of the outputs z belong into [system]",
        "gain": "a gain is given to a command: cosim analyse FILE --gain '[[...]]'",
    }
)
_MEANT: Final[Mapping[KeyPath, Mapping[str, str]]] = MappingProxyType(
    {(): _AT_THE_TOP, ("system",): _IN_SYSTEM, ("design",): _IN_DESIGN}
)
"""Table -> key that it does not have -> what to do."""


class SystemFile(Part):
    """A system, and what is to be designed for it."""

    meant: ClassVar[Mapping[str, str]] = MappingProxyType(
        {
            **dict.fromkeys(("measurements.age", "measurements.delay"), "d"),
            **dict.fromkeys(("gammamax", "hinfnorm", "bound"), "design.gamma"),
            **dict.fromkeys(("sys", "plant", "model", "matrices"), "system"),
            "alpha": "decay",
            "rateofdecay": "decay",
        }
    )
    examples: ClassVar[Mapping[str, str]] = MappingProxyType(
        {
            "A": "[[0.0, 1.0], [-1.0, -0.1]], a row per state",
            "B": "[[0.0], [1.0]], a row per state",
            "d": "0.3, in seconds",
            "gamma": "5.0",
            "k1": "[0.6], one number per delay",
            "k2": "[0.2], one number per delay",
            "decay": "0.5, in 1/s",
            "feedback": "true",
            "any_age": "true",
            "sampled": "true",
            "name": '"depth"',
            "states": "[1], numbers of states from 1",
        }
    )

    system: SystemTable
    """The matrices."""
    weights: FiltersPart | None = None
    """Weights that depend on frequency."""
    measurements: list[SensorPart] | None = None
    """The sensors."""
    observer: ObserverPart | None = None
    """An observer of the measurements."""
    design: DesignPart = Field(default_factory=DesignPart)
    """Settings and constraints of a design."""

    @classmethod
    def advice(cls, wrong: str, path: KeyPath, value: Any, data: Any) -> str | None:
        """Return what is meant by a key that systems do not have, or have elsewhere."""
        if wrong == "extra_forbidden":
            return _MEANT.get(path[:-1], {}).get(str(path[-1]))
        return SystemTable.advice(wrong, path, value, data)


def system_schema() -> dict[str, Any]:
    """Return the JSON Schema of a system file."""
    return SystemFile.model_json_schema()
