"""The theorem behind a claim, in words: every hypothesis and every conclusion, one per sentence.

A certificate has them under "theorem". They follow from its claim alone, and are checked against
it; older certificates are without them.
"""

from __future__ import annotations

from typing import Any

_SYSTEM = (
    "system: x' = sum_i (A_i + dA_i) x(t - tau_i) + B u + C w for almost every t >= 0, tau_0 = 0; "
    "z = D x + D1 w + D2 u"
)
_GAIN = (
    "conclusion: x = 0 for t <= 0 (zero initial function), w in L2[0, T], measurable: then the "
    "integral of z'z over [0, T] is at most gamma^2 times that of w'w, for every T > 0, also "
    "T = infinity"
)
_SAMPLED = (
    "a sampled age, a = least_age: x(t - tau) = x(s_k) for s_k + a <= t < s_(k+1) + a, "
    "0 < s_(k+1) - s_k <= d - a, s_0 + a <= 0, finitely many s_k in any bounded time"
)


def theorem_of(claim: dict[str, Any]) -> list[str]:
    """Return the sentences of a claim, as JSON values."""
    texts = [_SYSTEM, *_feedback(claim)]
    for i, delay in enumerate(claim["delays"], 1):
        known = [f"{key} = {delay[key]!r}" for key in ("d", "least_age", "rate") if key in delay]
        texts.append(f"age {i}: tau_{i} is {delay['age']}, in seconds, {', '.join(known)}")
    ages = [delay["age"] for delay in claim["delays"]]
    if any(not age.startswith("constant") for age in ages):
        texts.append("an age that varies is a measurable function of time")
    if any("|age'|" in age for age in ages):
        texts.append("an age with a bounded rate is Lipschitz continuous")
    if any(age.startswith("sampled") for age in ages):
        texts.append(_SAMPLED)
    texts.append(
        f"uncertainty: [dA_0 ... dA_N] = E F(t) [H_0 ... H_N], {uncertainty_text(claim, 'F')}"
        if claim["uncertain"]
        else "uncertainty: none, every dA_i = 0"
    )
    texts.append(
        "numbers: those of system and K are the doubles of this file, taken exactly; a p/q is the "
        "rational that it is; nothing is rounded"
    )
    if not claim["property"].startswith("stability"):
        return [*texts, f"conclusion: {claim['property']}"]
    texts.append("conclusion: w = 0 and any continuous initial function on [-max d, 0]: x(t) -> 0")
    if claim["gamma"] is not None:
        texts.append(_GAIN)
    more = claim.get("guarantees", {}).values()
    return texts + [f"conclusion: {one['property']}" for one in more]


def uncertainty_text(claim: dict[str, Any], F: str = "F(t)") -> str:
    """Return which F is covered by a claim with uncertainty; `F` is its name."""
    text = f"{F} measurable, F(t)'F(t) <= I, the same F in every term"
    if "uncertainty_blocks" not in claim:
        return text
    sizes = claim["uncertainty_blocks"]
    names = [f"F_{i}" for i in range(1, len(sizes) + 1)]
    each = ", ".join(f"{name} {p} x {q}" for name, (p, q) in zip(names, sizes, strict=True))
    text = text.replace("F(t)'F(t)", "F_i(t)'F_i(t)")
    return f"F = diag({', '.join(names)}), {each}, {text}; real or complex"


def _feedback(claim: dict[str, Any]) -> list[str]:
    """Return what the control is; nothing where a claim is about every gain."""
    fed = [claim.get("feedback", False), *(delay["feedback"] for delay in claim["delays"])]
    if any(isinstance(one, list) for one in fed):
        return ["control: u = K sum_i S_i x(t - tau_i), S_i the diagonal of feedback"]
    acting = next((i for i, one in enumerate(fed) if one), 0)
    at = f"x(t - tau_{acting})" if acting else "x(t)"
    return [f"control: u = K {at}, u = 0 without inputs; the full state is measured, without error"]
