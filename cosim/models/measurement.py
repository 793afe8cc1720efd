"""What a sensor tells a controller of the state: rows C, how old they are, how noisy.

    y(t) = C x(s) + v(s),  s the time at which it was taken, t - s its age

A measurement travels with its stamp s. `Delay` has the same words for the kinds of age.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from cosim.models.delay_system import Delay, Matrix, read_only_matrix
from cosim.models.values import Value

Over = Literal["link", "onboard"]
"""How a measurement reaches the observer: in packets over the link, or on board."""


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Measurement(Value):
    """k values measured of a state of n, with their age and their noise.

    Parameters
    ----------
    name : for messages and files.
    C : (k, n) what is measured.
    d : the age [s] where it is used, or the greatest; 0: at once.
    any_age, least_age, rate, sampled : what is known of an age that varies, as of `Delay`.
    noise : (k,) the size of v, each >= 0: v = diag(noise) w_v, and w_v is a disturbance like w.
        None: without noise.
    over : whether it comes in packets over the "link", or is taken "onboard".

    Raises
    ------
    ValueError : names the argument, what was expected and what was got.
    """

    name: str
    C: Matrix
    d: float
    any_age: bool
    least_age: float
    rate: float | None
    sampled: bool
    noise: tuple[float, ...]
    over: Over

    def __init__(
        self,
        name: str,
        C: ArrayLike,
        d: float = 0.0,
        *,
        any_age: bool = False,
        least_age: float = 0.0,
        rate: float | None = None,
        sampled: bool = False,
        noise: Sequence[float] | None = None,
        over: Over = "link",
    ) -> None:
        if not (isinstance(name, str) and name):
            raise ValueError(f"name of a measurement: expected a text, got {name!r}")
        rows = read_only_matrix(f"C of {name}", C, None, None)
        k, n = rows.shape
        if not (k and rows.any(axis=1).all()):
            raise ValueError(
                f"C of {name}: expected rows that are not all zero, got {rows.tolist()}"
            )
        kinds: dict[str, Any] = {"least_age": least_age, "rate": rate, "sampled": sampled}
        ages = Delay(d, np.zeros((n, n)), any_age=any_age, **kinds)
        values = tuple(float(x) for x in (noise if noise is not None else [0.0] * k))
        if len(values) != k or not all(np.isfinite(x) and x >= 0 for x in values):
            raise ValueError(
                f"noise of {name}: expected {k} numbers >= 0, one per row of C, got {list(values)}"
            )
        if over not in get_args(Over):
            raise ValueError(
                f"over of {name}: expected {' or '.join(get_args(Over))}, got {over!r}"
            )
        settings = (name, rows, ages.d, ages.any_age, ages.least_age, ages.rate, ages.sampled)
        for key, value in zip(self.__annotations__, (*settings, values, over), strict=True):
            object.__setattr__(self, key, value)

    def __repr__(self) -> str:
        age = "at once" if self.d == 0 else self.delay(self.C.shape[1]).description
        noisy = ", with noise" if any(self.noise) else ""
        return f"<Measurement {self.name!r}: {len(self.C)} values, {age}{noisy}, {self.over}>"

    def delay(self, n: int, feedback: bool | Sequence[Sequence[bool]] = False) -> Delay:  # noqa: FBT001, FBT002 - of `Delay`
        """Return its age as the delay of a term of a system with n states, zero but for K."""
        return Delay(
            *(self.d, np.zeros((n, n)), None, feedback, self.any_age),
            least_age=self.least_age,
            rate=self.rate,
            sampled=self.sampled,
        )

    @property
    def states(self) -> tuple[int, ...] | None:
        """The indices of the states that its values are; None where one is no state itself."""
        single = (self.C != 0).sum(axis=1) == 1
        if not (single & (self.C.sum(axis=1) == 1)).all():
            return None
        return tuple(int(j) for j in self.C.argmax(axis=1))
