"""What each word of a claim asks of a run.

A certificate says of every delay which ages its proof covers, in words that are checked against the
proof. Here each of these words has its rule, and nothing else decides which ages a run may have: a
word without a rule covers nothing. What is held between messages or steps is never constant, so
that a proof about a constant age of the feedback, of a measurement or of a command covers no run.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from cosim.hinf.certificate import AgeWord
from cosim.models import Delay
from cosim.scenario.gain import observes

if TYPE_CHECKING:
    from cosim.hinf import Result

_CLOSE = 1e-12
"""Relative: ages are doubles of whole nanoseconds."""


@dataclass(frozen=True)
class AgeRule:
    """What a word about an age covers.

    Attributes
    ----------
    varies : whether it covers the age of a value that is held: it grows at rate one, then falls.
    sampled : it covers one that is always the same when a value comes into use.
    least : it is never less than the `least_age` of the delay.
    constant : value, d and least_age -> whether it covers a constant delay of this value, such as
        one in a plant.
    """

    constant: Callable[[float, float, float], bool]
    varies: bool = False
    sampled: bool = False
    least: bool = False


def _up_to(value: float, d: float, least: float) -> bool:
    return least <= value <= d


def _exactly(value: float, d: float, least: float) -> bool:
    del least
    return value == d


def _never(value: float, d: float, least: float) -> bool:
    del value, d, least
    return False


AGE_RULES: Mapping[str, AgeRule] = MappingProxyType(
    {
        AgeWord.ANY: AgeRule(_up_to, varies=True),
        AgeWord.ANY_FROM: AgeRule(_up_to, varies=True, least=True),
        AgeWord.SAMPLED: AgeRule(_never, varies=True, sampled=True, least=True),
        AgeWord.RATE: AgeRule(_up_to, least=True),
        AgeWord.UP_TO: AgeRule(_up_to),
        AgeWord.EXACTLY: AgeRule(_exactly),
    }
)
"""Word of a claim about a delay -> what it covers."""
_FROM = re.compile(r"constant, from (\S+) to d")
_UNKNOWN = AgeRule(_never)

KINDS = frozenset({"certificate", "analysis", "ages", "output-feedback"})
"""Kinds of certificates of which a run may claim something."""
GUARANTEES: Mapping[str, str] = MappingProxyType(
    {
        "decay": "the bound of the decay is about the loop whose law is measured",
        "damping": "about the nominal loop alone",
        "gain_limit": "about K alone, which is compared",
        "peak_control": "about the loop whose law is measured",
        "state_peaks": "about the loop whose law is measured",
        "outages": "its own division of time, `cosim.scenario.outage_measure`",
    }
)
"""Guarantee of a certificate -> what of a run it rests on."""


def age_rule(word: str) -> AgeRule:
    """Return the rule of a word; of an unknown word one that covers nothing."""
    if word in AGE_RULES:
        return AGE_RULES[word]
    lower = _FROM.fullmatch(word)
    if lower is None:
        return _UNKNOWN
    least = float(Fraction(lower[1]))
    return AgeRule(lambda value, d, _: least <= value <= d)


def unknown_words(design: Result) -> list[str]:
    """Return what the claim of a design says that has no rule here."""
    claim, kind = design.certificate["claim"], design.certificate.get("kind", "certificate")
    found = [] if kind in KINDS else [f"a certificate of kind {kind}"]
    ages = (delay["age"] for delay in claim["delays"])
    found += [f"an age that is {age!r}" for age in ages if age_rule(age) is _UNKNOWN]
    found += [f"guarantee {x!r}" for x in claim.get("guarantees", {}) if x not in GUARANTEES]
    return found


def covers_plant_delays(
    design: Result, delays: Mapping[str, float], own: Mapping[str, float | None]
) -> Iterator[tuple[str, float | None, float]]:
    """Yield name, value and designed value of each delay of a plant that is not covered.

    Parameters
    ----------
    delays : the designed values by name of the parameter, in the order of the system.
    own : the values of the plant.
    """
    terms = [x for x in design.system.delays if not x.feedback or x.A.any() or x.H.any()]
    claimed = zip(design.system.delays, _claimed(design), strict=True)
    words = {id(x): each["age"] for x, each in claimed}
    for i, (name, d) in enumerate(delays.items()):
        value, rule, least = own.get(name), AGE_RULES[AgeWord.EXACTLY], 0.0
        if i < len(terms):
            rule = age_rule(words[id(terms[i])])
            least = terms[i].least_age
        if value is None or not rule.constant(value, d, least):
            yield name, value, d


def _claimed(design: Result) -> list[dict[str, Any]]:
    """Return what is claimed of each delay of the plant."""
    if not observes(design):
        claimed: list[dict[str, Any]] = design.certificate["claim"]["delays"]
        return claimed
    # the observer goes by the delay of the design: a constant one must be the plant's
    return [{"age": AgeWord.ANY if x.any_age else AgeWord.EXACTLY} for x in design.system.delays]


def certified_age(design: Result) -> float | None:
    """Return the greatest age of held feedback that a proof covers [s]; None if it covers none."""
    ages = [(x.d, age_rule(word).varies) for x, word in feedback_words(design)]
    if observes(design) or not ages or not all(varies for _, varies in ages):
        return None
    return max(d for d, _ in ages)


def word_of(delay: Delay) -> str:
    """Return the word of a delay of a design with an observer, whose measurements have fields."""
    if delay.sampled:
        return AgeWord.SAMPLED
    if delay.rate is not None:
        return AgeWord.RATE
    if delay.any_age:
        return AgeWord.ANY_FROM if delay.least_age else AgeWord.ANY
    return AgeWord.EXACTLY


def feedback_words(design: Result) -> list[tuple[Delay, str]]:
    """Return the delays of the feedback with their words; none for one that acts at once."""
    words: list[dict[str, Any]] = design.certificate["claim"]["delays"]
    return [
        (delay, own["age"])
        for own, delay in zip(words, design.system.delays, strict=True)
        if delay.feedback
    ]
