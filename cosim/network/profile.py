"""A recorded delay: a function of time, given by samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import AnyPath, InputError, say_once
from cosim.network.checks import MAX_NS, check_choice
from cosim.network.file_rows import read_columns
from cosim.network.log_format import LogFormat, unit_doubt

Interpolation = Literal["previous", "linear"]
"""What a recorded delay is between two samples."""


@dataclass(frozen=True, slots=True, eq=False)
class DelayProfile:
    """Delay over time; before the first and after the last sample it is constant.

    Parameters
    ----------
    times_ns : strictly increasing, counted from the start of the run [ns]; int64 (n,), n >= 1.
    delays_ns : delay from each instant on [ns], in [0, 2**53]; int64 (n,).
    interpolation : "previous": each delay holds until the next sample. "linear": on a straight
        line between two samples, rounded to the nearest nanosecond (ties to even), in exact
        integer arithmetic.

    Raises
    ------
    InputError : samples out of order or out of range; the message names the first of them.
    """

    times_ns: NDArray[np.int64]
    delays_ns: NDArray[np.int64]
    interpolation: Interpolation = "previous"

    def __post_init__(self) -> None:
        where, kinds = "delay profile: interpolation", get_args(Interpolation)
        check_choice(where, "interpolation", self.interpolation, kinds)
        for key, least in (("times_ns", -MAX_NS), ("delays_ns", 0)):
            object.__setattr__(self, key, _samples(key, getattr(self, key), least))
        if self.times_ns.size != self.delays_ns.size:
            raise InputError(
                "a delay profile needs one delay for each instant",
                where="delay profile",
                expected=f"{self.times_ns.size} delays",
                got=f"{self.delays_ns.size}",
            )
        if (np.diff(self.times_ns) <= 0).any():
            k = int(np.argmax(np.diff(self.times_ns) <= 0)) + 1
            raise InputError(
                "the instants of a delay profile do not increase",
                where=f"delay profile: times_ns[{k}]",
                expected=f"more than {self.times_ns[k - 1]} ns",
                got=f"{self.times_ns[k]} ns",
            )

    @classmethod
    def from_seconds(
        cls, times_s: ArrayLike, delays_s: ArrayLike, interpolation: Interpolation = "previous"
    ) -> DelayProfile:
        """Make a profile of times and delays in seconds, rounded to the nearest nanosecond.

        Raises
        ------
        InputError : as `DelayProfile`, or a value that is not a finite number.
        """
        columns = []
        for key, given in (("times_s", times_s), ("delays_s", delays_s)):
            try:
                seconds = np.asarray(given, np.float64)
            except (TypeError, ValueError) as error:
                raise InputError(
                    "a delay profile is made of numbers",
                    where=f"delay profile: {key}",
                    expected="seconds",
                    got=str(error),
                ) from error
            inside = np.abs(seconds) <= MAX_NS / 1e9
            if not inside.all():
                k = int(np.argmin(inside))
                raise InputError(
                    "a sample of the delay profile is out of range",
                    where=f"delay profile: {key}[{k}]",
                    expected=f"up to {MAX_NS / 1e9:g} s",
                    got=f"{seconds.flat[k]} s",
                    hint="times count from the start of the run",
                )
            columns.append(np.rint(seconds * 1e9).astype(np.int64))
        return cls(columns[0], columns[1], interpolation)

    @classmethod
    def from_csv(
        cls,
        path: AnyPath,
        *,
        time: str = "time",
        delay: str = "delay",
        interpolation: Interpolation = "previous",
        log_format: LogFormat | None = None,
    ) -> DelayProfile:
        """Read a profile from a CSV file: a header line, then a line for each sample.

        A median delay of more than a minute is asked about on standard error.

        Parameters
        ----------
        path : file, UTF-8. Empty lines, and lines that begin with #, are skipped.
        time, delay : names of the two columns that are read, both from the start of the run;
            decimal fractions are read exactly and rounded to the nearest nanosecond.
        log_format : delimiter, decimal and unit of the file; without it found, and seconds.

        Raises
        ------
        InputError : a file that cannot be read, a missing column, a bad value; the message
            names file, line and column. Other keys of a format, which a profile does not have.
        """
        written = log_format or LogFormat()
        alone = LogFormat(
            delimiter=written.delimiter,
            decimal=written.decimal,
            unit=written.unit,
            hints=written.hints,
        )
        if written != alone:
            raise InputError(
                "a delay over time has no messages",
                where="format",
                expected="delimiter, decimal and unit alone",
                got="other keys beside them",
                hint="time and delay name its columns; messages that were lost are of a recording",
            )
        profile = cls(*read_columns(path, time, delay, written), interpolation)
        median_s = float(np.median(profile.delays_ns)) / 1e9
        doubt = unit_doubt(median_s, written.unit or "s", written)
        if doubt is not None:
            say_once(f"{path}: {doubt}")
        return profile

    def delay_ns(self, at_ns: ArrayLike) -> NDArray[np.int64]:
        """Return the delay at each instant [ns], in the shape of `at_ns`."""
        wanted = np.asarray(at_ns, np.int64)
        at = np.clip(wanted.ravel(), self.times_ns[0], self.times_ns[-1])
        place = np.searchsorted(self.times_ns, at, side="right") - 1
        if self.interpolation == "previous" or self.times_ns.size == 1:
            return self.delays_ns[place].reshape(wanted.shape)
        place = np.minimum(place, self.times_ns.size - 2)
        rise = self.delays_ns[place + 1] - self.delays_ns[place]
        whole = self.times_ns[place + 1] - self.times_ns[place]
        line = _between(self.delays_ns[place], rise, at - self.times_ns[place], whole)
        return line.reshape(wanted.shape)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, DelayProfile):
            return NotImplemented
        return self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def _key(self) -> tuple[bytes, bytes, str]:
        return self.times_ns.tobytes(), self.delays_ns.tobytes(), self.interpolation


def _samples(key: str, given: Any, least: int) -> NDArray[np.int64]:
    """Return a read-only int64 copy of integers, checked to lie in [least, 2**53]."""
    values = np.asarray(given)
    if values.ndim != 1 or values.size == 0 or not np.issubdtype(values.dtype, np.integer):
        raise InputError(
            "a delay profile is made of integer nanoseconds",
            where=f"delay profile: {key}",
            expected="at least one integer, in one dimension",
            got=f"array of {values.dtype}, shape {values.shape}",
            hint="DelayProfile.from_seconds takes seconds",
        )
    outside = (values < least) | (values > MAX_NS)
    if outside.any():
        k = int(np.argmax(outside))
        raise InputError(
            "a sample of the delay profile is out of range",
            where=f"delay profile: {key}[{k}]",
            expected=f"{'-2**53' if least else '0'} to 2**53 ns",
            got=f"{values[k]} ns",
            hint="times count from the start of the run",
        )
    samples = values.astype(np.int64)
    samples.setflags(write=False)
    return samples


def _between(
    start: NDArray[np.int64],
    rise: NDArray[np.int64],
    part: NDArray[np.int64],
    whole: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Return start + rise part / whole to the nearest integer, ties to even; 0 <= part <= whole.

    With rise = q whole + r the product is q part + r part / whole, where r part < whole**2 may
    exceed 64 bits: Python's integers are used there.
    """
    q, r = np.divmod(rise, whole)
    wide = bool(whole.size) and int(whole.max()) ** 2 >= 2**62
    product: Any = r.astype(object) * part if wide else r * part
    floor = (product // whole).astype(np.int64)
    rest = (product - floor * whole.astype(product.dtype)).astype(np.int64)
    below = start + q * part + floor
    up = (rest > whole - rest) | ((rest == whole - rest) & (below % 2 == 1))
    result: NDArray[np.int64] = below + up
    return result
