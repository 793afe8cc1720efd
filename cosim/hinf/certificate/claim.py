"""The claim of a certificate, what its file states beside it, and the outcome of a check."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from cosim.core import html_table
from cosim.hinf.certificate.document import claim_words, theorem_rows
from cosim.hinf.certificate.system_json import feedback_to_json
from cosim.hinf.certificate.words import PROPERTIES, AgeWord, theorem_of
from cosim.hinf.exact import to_text
from cosim.models import DelaySystem, Matrix


@dataclass(frozen=True, repr=False)
class CertificateCheck:
    """Outcome of an exact check.

        >>> from cosim.hinf import DelaySystem, analyse
        >>> check = analyse(DelaySystem(A=[[-1]], C=[[1]], D=[[1]])).check()
        >>> check.valid, check.reason, check.claim["property"]
        (True, None, 'stability and H-infinity gain <= gamma')

    valid : whether the claim is proved.
    reason : why it is not; None if it is.
    claim : the claim, as in the JSON (see `claim_of`).
    not_read : the keys of the file on which the outcome does not depend, such as `figures` and
        `system.name`: notes and names, which are not proved.
    """

    valid: bool
    reason: str | None
    claim: dict[str, Any]
    not_read: tuple[str, ...] = field(default=(), compare=False)  # of the file, not of the proof

    def __repr__(self) -> str:
        outcome = "valid" if self.valid else f"not valid: {self.reason}"
        return f"<CertificateCheck: {outcome}; {claim_words(self.claim)}>"

    def _repr_html_(self) -> str:
        """Return the outcome and every sentence of the theorem, as notebooks show them."""
        more = {"not read": ", ".join(self.not_read)} if self.not_read else {}
        return html_table(repr(self), theorem_rows(self.claim) | more)


@dataclass(frozen=True, eq=False)
class Statement:
    """What the parts of a file state: a claim, and what proves it.

    claim : the one that they make.
    failure : runs the proof; why the claim is not proved, or None.
    loop : the system and the gain (m, n) that guarantees beside the claim are about; None where
        there can be none.
    makers : the parts of the file that make the claim, for messages.
    """

    claim: dict[str, Any]
    failure: Callable[[], str | None]
    loop: tuple[DelaySystem, Matrix] | None = None
    makers: str = "system and variables"

    def judged(self, data: dict[str, Any]) -> CertificateCheck:
        """Check that a file with `claim`, and perhaps `theorem`, claims this, and the proof."""
        theorem = theorem_of(self.claim)
        if data["claim"] != self.claim:
            reason: str | None = f"the claim is not the one that {self.makers} make"
        elif data.get("theorem", theorem) != theorem:
            reason = "the theorem is not the one of the claim"
        else:
            reason = self.failure()
        return CertificateCheck(valid=reason is None, reason=reason, claim=self.claim)


def document_of(claim: dict[str, Any], *, kind: str | None = None, **parts: Any) -> dict[str, Any]:
    """Return a certificate as JSON values: its claim, the theorem of that, and what proves it."""
    head = {} if kind is None else {"kind": kind}
    return {**head, "theorem": theorem_of(claim), "claim": claim, **parts}


def claim_of(system: DelaySystem, gamma: Any) -> dict[str, Any]:
    """Return the claim of a certificate as JSON values.

    gamma : the rational bound of the gain from w to z; None if only stability is claimed.
    """
    return {
        "property": PROPERTIES["stability" if gamma is None else "gain"],
        "gamma": None if gamma is None else to_text(gamma),
        "delays": [
            {
                "d": delay.d,
                "age": (AgeWord.ANY if delay.any_age else AgeWord.UP_TO).value,
                "feedback": feedback_to_json(delay.feedback),
            }
            for delay in system.delays
        ],
        **uncertainty_claim(system),
        "inputs": "doubles",
        **({} if system.feedback is None else {"feedback": feedback_to_json(system.feedback)}),
    }


def covers_smaller(claim: dict[str, Any]) -> bool:
    """Whether a claim covers every delay from zero up to the system's."""
    return all(
        delay["age"] != AgeWord.EXACTLY and "from" not in delay["age"] for delay in claim["delays"]
    )


def uncertainty_claim(system: DelaySystem) -> dict[str, Any]:
    """Return the part of a claim that says which F is covered: one full block, or several."""
    sizes = system.uncertainty_blocks
    more = {} if sizes is None else {"uncertainty_blocks": [list(size) for size in sizes]}
    return {"uncertain": bool(system.blocks), **more}
