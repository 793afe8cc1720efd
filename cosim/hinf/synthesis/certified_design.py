"""A design: a gain with its proof.

It stands apart from what makes one: a run reads a design, and loads no solver for that.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import html_table, matrix_text
from cosim.hinf.certificate import Certificate, Guarantees, check_certificate
from cosim.hinf.nominal import HasFigures
from cosim.hinf.synthesis.result_text import proved_words, result_rows
from cosim.hinf.synthesis.same_as_proved import require_proved_gain
from cosim.models import DelaySystem, Value

if TYPE_CHECKING:
    from cosim.hinf.nominal import NominalFigures


@dataclass(frozen=True, eq=False, repr=False)
class Design(HasFigures, Value):
    """A certified gain, with its proof and the figures of its nominal loop.

    It cannot be changed, and two designs are equal where everything they say is. Another gain is
    another design: `analyse` it.

    Attributes
    ----------
    system : the system it is designed for.
    K : (m, n) the gain, as its doubles.
    gamma : certified bound of the gain from w to z, uncertainty included; None where the
        system has no w or no z, and stability alone is certified.
    k1, k2 : one per delay; empty where the proof has an `order`.
    least_gamma : the solver's least gamma at k1, k2; not proved.
    figures : of the nominal loop. They are attributes of the design too, `abscissa`,
        `exact_norm`, `exact_norm_upper`, `norm_frequency`, `delay_margin` and `worst_case`: see
        `NominalFigures`. None where an older file has none.
    certificate : the proof as JSON values, for `check_certificate`.
    order : Bessel-Legendre order of the proof, an analysis of K without k1, k2; None for
        Theorem 2.
    guarantees : the design constraints that are proved, also in the certificate.

    Raises
    ------
    InputError : made with a system, gain, bound or guarantee that is not the certificate's.
    """

    system: DelaySystem
    K: NDArray[np.float64]
    gamma: float | None
    k1: tuple[float, ...]
    k2: tuple[float, ...]
    least_gamma: float | None
    figures: NominalFigures
    certificate: dict[str, Any]
    order: int | None = None
    guarantees: Guarantees = field(default_factory=Guarantees)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "certificate", Certificate(self.certificate))
        stated: dict[str, Any] = {"gamma": self.gamma, "order": self.order}
        if self.order is None:
            stated |= {"k1": self.k1, "k2": self.k2}
        require_proved_gain(self.certificate, self.system, self.K, stated, self.guarantees)

    def __repr__(self) -> str:
        name = f" {self.system.name!r}" if self.system.name else ""
        return f"<Design{name}: K = {matrix_text(self.K)}, {proved_words(self)}>"

    def _repr_html_(self) -> str:
        """Return the gain, what is proved of it and the figures of its loop, for notebooks."""
        return html_table(repr(self), {"system": repr(self.system)[1:-1], **result_rows(self)})

    @property
    def covers_smaller_delays(self) -> bool:
        """Whether the proof covers every delay up to the system's, not exactly these alone."""
        if self.order is None:
            return True
        from cosim.hinf.certificate import covers_smaller  # noqa: PLC0415 - of analyses only

        return covers_smaller(self.certificate["claim"])

    @cached_property
    def certified(self) -> bool:
        """Whether the proof holds: checked here, once, so that no certificate is believed."""
        return check_certificate(self.certificate).valid
