"""The greatest delay that is certified, and what is known beyond it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cosim.hinf.certificate import Certificate
from cosim.hinf.synthesis.result import Result


@dataclass(frozen=True, eq=False, repr=False)
class GreatestDelay:
    """The greatest delay that is certified, of a gain that is designed for it or of a given one.

        >>> from cosim import link
        >>> from cosim.hinf import DelaySystem, greatest_delay
        >>> system = DelaySystem(
        ...     A=[[0.1]], B=[[1]], C=[[1]], D=[[1], [0]], D2=[[0], [1]], delays=[link(0.1)]
        ... )
        >>> greatest = greatest_delay(system, 2.0, k1=[-1], k2=[1])
        >>> round(greatest.delay, 1), greatest.limit_reached, greatest.result.certified
        (0.6, False, True)
        >>> greatest.delay < greatest.refuted_at < 1.001 * greatest.delay
        True

    Attributes
    ----------
    delay_index : index of the delay in `system.delays`; the others are kept.
    delay : the greatest certified delay [s]; None if no delay is certified.
    result : the gain and its proof at that delay; of the system as given if none is certified.
    limit_reached : whether `delay` is the limit of the search; nothing is known beyond it.
    not_certified_at : a delay [s] just above it without a proof; None where none was tried.
    refuted_at : a delay [s] just above it from which on the LMI is proved to have no solution at
        the result's k1, k2; None: no proof of that.
    refutation : that proof as JSON values, for `check_certificate`.
    """

    delay_index: int
    delay: float | None
    result: Result
    limit_reached: bool
    not_certified_at: float | None = None
    refuted_at: float | None = None
    refutation: dict[str, Any] | None = None

    def __post_init__(self) -> None:
        if self.refutation is not None:
            object.__setattr__(self, "refutation", Certificate(self.refutation))

    def __repr__(self) -> str:
        if self.delay is None:
            return f"<GreatestDelay: none, {self.result!r}>"
        end = ""
        if self.limit_reached:
            end = ", the limit of the search"
        elif self.refuted_at is not None:
            end = f", refuted from {self.refuted_at:.6g} s on"
        which = f"delay {self.delay_index + 1} up to {self.delay:.6g} s"
        return f"<GreatestDelay: {which}{end}, {self.result!r}>"
