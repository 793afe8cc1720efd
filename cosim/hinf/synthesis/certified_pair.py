"""A certified observer with its gain, as a result and as JSON: what designs of pairs return."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

from cosim.core import InputError, html_table, matrix_text
from cosim.hinf import nominal
from cosim.hinf.certificate import (
    Certificate,
    ObserverPair,
    StatePeaks,
    check_certificate,
    covers_smaller,
    guarantees_from_json,
    pair_from_json,
)
from cosim.hinf.synthesis.kept_figures import figures_from_json, figures_to_json, has_figures
from cosim.hinf.synthesis.result_text import proved_words, result_rows
from cosim.hinf.synthesis.same_as_proved import require_proved_pair
from cosim.models import DelaySystem, Matrix, Measurement, Value


@dataclass(frozen=True, eq=False, repr=False)
class OutputFeedback(nominal.HasFigures, Value):
    """An observer and its gain, certified together, with the figures of their nominal pair.

    It cannot be changed, and two are equal where everything they say is.

    Attributes
    ----------
    pair : plant and observer as one system; what is analysed.
    gamma : certified bound of the gain from (w, w_1 .. w_p) to z, uncertainty included; None where
        the plant has no z or nothing acts on it, and stability alone is certified.
    certificate : the proof as JSON values, for `check_certificate`, of kind "output-feedback".
    order : Bessel-Legendre order of the proof.
    least_gamma : the solver's least gamma; not proved.
    figures : of the nominal pair, which are attributes too: `abscissa`, `exact_norm`, ...
    state_peaks : bounds of every |u_i(t)|, then of every |x_i(t)|, where they were asked for.

    Raises
    ------
    InputError : made with a pair, bound or peaks that are not the certificate's.
    """

    pair: ObserverPair
    gamma: float | None
    certificate: dict[str, Any]
    order: int
    least_gamma: float | None
    figures: nominal.NominalFigures
    state_peaks: StatePeaks | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "certificate", Certificate(self.certificate))
        stated = {"gamma": self.gamma, "order": self.order}
        require_proved_pair(self.certificate, self.pair, stated, self.state_peaks)

    def __repr__(self) -> str:
        name = f" {self.system.name!r}" if self.system.name else ""
        names = ", ".join(x.name for x in self.measurements)
        return f"<OutputFeedback{name}: observer of {names}, {proved_words(self)}>"

    def _repr_html_(self) -> str:
        """Return the gains, what is proved and the figures of the pair, for notebooks."""
        rows = {"system": repr(self.system)[1:-1], "K": matrix_text(self.K)}
        rows |= {
            f"L of {x.name}": matrix_text(L_i)
            for x, L_i in zip(self.measurements, self.L, strict=True)
        }
        return html_table(repr(self), rows | result_rows(self))

    @property
    def system(self) -> DelaySystem:
        """The plant."""
        return self.pair.plant

    @property
    def measurements(self) -> tuple[Measurement, ...]:
        """What the observer receives, with the noise that is proved."""
        return self.pair.measurements

    @property
    def K(self) -> Matrix:
        """The gain (m, n): u = K xh."""
        return self.pair.K

    @property
    def L(self) -> tuple[Matrix, ...]:
        """The injection (n, k_i) of every measurement."""
        return self.pair.L

    @cached_property
    def certified(self) -> bool:
        """Whether the proof holds: checked here, once, so that no certificate is believed."""
        return check_certificate(self.certificate).valid

    @property
    def covers_smaller_delays(self) -> bool:
        """Whether the proof covers every delay up to the system's, not exactly these alone."""
        return covers_smaller(self.certificate["claim"])

    def to_json(self) -> dict[str, Any]:
        """Return the certificate, and the figures of the nominal pair beside it."""
        return {**self.certificate, "figures": figures_to_json(self)}


def output_feedback_from_json(data: Any, *, where: str) -> OutputFeedback:
    """Read an output feedback from its certificate, and check its proof again.

    The figures of the nominal pair, which no claim depends on, are those that the file has; a
    certificate alone has none, and they are computed.

    Raises
    ------
    InputError : not an output feedback, or one whose proof does not hold.
    """
    kind = data.get("kind") if isinstance(data, dict) else None
    if kind != "output-feedback":
        raise InputError(
            "not an output feedback", where=where, expected="kind output-feedback", got=str(kind)
        )
    proof = check_certificate(data)
    if not proof.valid:
        raise InputError("the proof does not hold", where=where, got=proof.reason)
    pair, variables = pair_from_json(data), data["pair"]["variables"]
    kept = data.get("figures")
    if has_figures(kept) and "delay_margin" in kept:  # older files have not all of them
        least, figures = figures_from_json(kept, where, pair.system, pair.gain)
    else:
        least, figures = None, nominal.nominal_figures_of(pair.system, pair.gain)
    gamma = variables["gamma"]
    return OutputFeedback(
        pair=pair,
        gamma=None if gamma is None else float(Fraction(gamma)),
        certificate={key: x for key, x in data.items() if key not in ("figures", "schema")},
        order=variables["order"],
        state_peaks=guarantees_from_json(data["pair"], pair.system, pair.gain).state_peaks,
        least_gamma=least,
        figures=figures,
    )
