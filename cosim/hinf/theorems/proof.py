"""A theorem about a gain with its parameters, and the unknowns that prove it, by name.

The names, shapes and symmetry of the unknowns are those of the theorem's inequalities: arrays and
floats from a solver, `flint.fmpq_mat` and `fmpq` in a proof.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.core import InputError
from cosim.hinf.exact import asymmetric, exact, exact_matrix, exact_symmetric
from cosim.hinf.theorems.inequality import Inequality, Shape, first_failure

if TYPE_CHECKING:
    from cosim.models import DelaySystem, Matrix

MAX_ROWS = 400
"""Largest LMI that is checked; the vehicle's with two delays has some 70 rows."""


class Theorem(ABC):
    """A theorem about u = K x(t - age), with its parameters."""

    @abstractmethod
    def inequalities(
        self, system: DelaySystem, gain: Matrix, *, bounded: bool
    ) -> Iterable[Inequality]:
        """Return everything that must be positive; `bounded`: there is a gamma to prove."""

    @abstractmethod
    def shapes(self, system: DelaySystem, gain: Matrix, *, bounded: bool) -> dict[str, Shape]:
        """Return the shape of every unknown by its name.

        Raises
        ------
        InputError : more than `MAX_ROWS` rows.
        """

    @abstractmethod
    def obstacle(
        self, system: DelaySystem, gain: Matrix, unknowns: Mapping[str, Any]
    ) -> str | None:
        """Return what is wrong beside the inequalities, in rationals; None if nothing is.

        Raises
        ------
        InputError : parameters that do not fit the system, or an LMI that is too large.
        """


@dataclass(frozen=True, eq=False)
class Proof:
    """A theorem, and its unknowns by name; `gamma` among them where a gain is bounded."""

    theorem: Theorem
    unknowns: Mapping[str, Any]

    @property
    def gamma(self) -> Any:
        """The bound of the gain from w to z; None for stability alone."""
        return self.unknowns.get("gamma")

    def shapes(self, system: DelaySystem, gain: Matrix) -> dict[str, Shape]:
        """Return the shape of every unknown by its name, as `Theorem.shapes`."""
        return self.theorem.shapes(system, gain, bounded=self.gamma is not None)

    def exactly(self, system: DelaySystem, gain: Matrix) -> Proof:
        """Return it with the doubles as rationals; symmetric matrices are made so, exactly.

        Raises
        ------
        InputError : an unknown that is missing, not finite or of another shape.
        """
        return Proof(self.theorem, exact_unknowns(self.shapes(system, gain), self.unknowns))

    def failure(self, system: DelaySystem, gain: Matrix) -> str | None:
        """Return which condition is not proved in rational arithmetic; None if all are.

        Parameters
        ----------
        system : its doubles are taken exactly.
        gain : (m, n) K, its doubles taken exactly.

        Raises
        ------
        InputError : as `Theorem.obstacle`.
        """
        reason = self.theorem.obstacle(system, gain, self.unknowns)
        if reason is not None:
            return reason
        name = not_symmetric(self.shapes(system, gain), self.unknowns)
        if name is not None:
            return f"{name} is not symmetric"
        bounded = self.gamma is not None
        forms = self.theorem.inequalities(system, gain, bounded=bounded)
        return first_failure(forms, with_inverse_of_gamma(self.unknowns))


def with_inverse_of_gamma(unknowns: Mapping[str, Any]) -> dict[str, Any]:
    """Return unknowns with 1/gamma, where there is a gamma above zero."""
    gamma = unknowns.get("gamma")
    return {**unknowns, **({"1/gamma": 1 / gamma} if gamma is not None and gamma > 0 else {})}


def not_symmetric(shapes: Mapping[str, Shape], unknowns: Mapping[str, Any]) -> str | None:
    """Return the name of the first `fmpq_mat` that must be symmetric and is not, or None."""
    matrices = (name for name, x in shapes.items() if x.symmetric and not x.is_number)
    return asymmetric((name, unknowns[name]) for name in matrices)


def exact_unknowns(shapes: Mapping[str, Shape], unknowns: Mapping[str, Any]) -> dict[str, Any]:
    """Return the unknowns of these shapes as rationals, the symmetric ones made so, exactly.

    Raises
    ------
    InputError : one that is missing, not finite or of another shape.
    """
    return {name: _exactly(name, shape, unknowns.get(name)) for name, shape in shapes.items()}


def _exactly(name: str, shape: Shape, value: Any) -> Any:
    if shape.is_number:
        if value is None or not np.isfinite(value):
            raise InputError("not finite", where=name, expected="a finite number", got=repr(value))
        return exact(value)
    size = shape.height, shape.width
    array = np.asarray(np.zeros(0) if value is None else value, dtype=np.float64)
    if array.shape != size or not np.isfinite(array).all():
        raise InputError(
            "not a matrix of finite numbers",
            where=name,
            expected=f"shape {size}",
            got="none" if value is None else f"shape {array.shape}",
        )
    return exact_symmetric(array) if shape.symmetric else exact_matrix(array)


def require_size(
    got: int, most: int = MAX_ROWS, what: str = "rows", *, done: str = "proved"
) -> None:
    """Refuse a proof with more of something than are tried; `done` : what is done with the LMI.

    Raises
    ------
    InputError : more than `most`.
    """
    if got > most:
        raise InputError(
            f"the LMI is too large to be {done} here",
            where="system",
            expected=f"at most {most} {what}",
            got=f"{got} {what}",
        )
