"""The mutations: a file, its text, what stands there instead, and what a run would then claim."""

from __future__ import annotations

from dataclasses import dataclass

ROOM = "cosim/scenario/guarantee/"


@dataclass(frozen=True)
class Mutation:
    """One change of the tree that claims too much.

    Attributes
    ----------
    name : what would be claimed.
    file, old, new : the change; `old` stands once in the file.
    kinds : of loops in which it has to show.
    """

    name: str
    file: str
    old: str
    new: str
    kinds: tuple[str, ...]


def _of(room: str, name: str, old: str, new: str, *kinds: str) -> Mutation:
    return Mutation(name, f"{ROOM}{room}.py", old, new, kinds)


MUTATIONS: tuple[Mutation, ...] = (
    # ---- ages
    _of(
        "ages",
        "any greatest age",
        "if measured.greatest_ns / 1e9 > d:",
        "if measured.greatest_ns / 1e9 > 2 * d:",
        "any",
        "two",
    ),
    _of(
        "ages",
        "a greatest age that is a microsecond beyond",
        "fed_back.d * (1 + _CLOSE)",
        "fed_back.d * (1 + 1e-6)",
        "any",
    ),
    _of(
        "ages",
        "any least age",
        "elif least / 1e9 < fed_back.least * (1 - _CLOSE):",
        "elif least / 1e9 < 0.5 * fed_back.least:",
        "least",
    ),
    _of(
        "ages",
        "substitutes, of losses and of watchdogs",
        "if substituted or measured.interrupted:",
        "if False:",
        "any",
    ),
    _of(
        "ages",
        "any sampled age",
        "if abs(age / 1e9 - fed_back.least) > _CLOSE * fed_back.d:",
        "if abs(age / 1e9 - fed_back.least) > fed_back.d:",
        "sampled",
    ),
    _of(
        "ages",
        "old commands",
        "late = greatest_ns / 1e9 > bound * (1 + _CLOSE)",
        "late = greatest_ns / 1e9 > 100 * bound",
        "one",
        "two",
    ),
    _of(
        "ages",
        "held commands of a constant age",
        "if not pair.command_any_age:",
        "if False:",
        "constant",
    ),
    _of(
        "claim",
        "a constant age of what is held",
        "AgeWord.EXACTLY: AgeRule(_exactly),",
        "AgeWord.EXACTLY: AgeRule(_exactly, varies=True),",
        "constant",
    ),
    _of(
        "claim",
        "a plant delay shorter than exactly d",
        "    return value == d\n",
        "    return value <= d\n",
        "exact",
        "inner",
    ),
    _of(
        "claim",
        "a plant delay longer than up to d",
        "    return least <= value <= d\n",
        "    return least <= value\n",
        "upto",
    ),
    _of(
        "claim",
        "an observer's plant delay up to d",
        '[{"age": AgeWord.ANY if x.any_age else AgeWord.EXACTLY}',
        '[{"age": AgeWord.ANY}',
        "inner",
    ),
    # ---- wiring
    _of(
        "wiring",
        "states that are not connected",
        'return self._by_target.get(end) or "not connected"',
        "return self._by_target.get(end) or next(iter(self._by_target.values()))",
        "any",
        "two",
    ),
    _of(
        "wiring",
        "given series",
        'return "a given series or path"',
        "return self._by_target.get(end) or next(iter(self._by_target.values()))",
        "any",
        "two",
    ),
    _of(
        "wiring",
        "any form of the states",
        "        if not same or offset != 0.0:\n            yield Departure(str(end), text",
        "        if False:\n            yield Departure(str(end), text",
        "any",
        "two",
    ),
    _of(
        "wiring",
        "any gain",
        "abs(x - wanted[place.variable]) <= _CLOSE * abs(wanted[place.variable])",
        "abs(x - wanted[place.variable]) < 1e9",
        "any",
        "two",
    ),
    _of("wiring", "any offset", "if not same or offset != 0.0:", "if not same:", "any", "two"),
    _of(
        "wiring",
        "values behind a sensor with a gain",
        "if not known or gain != 1.0 or offset != 0.0:",
        "if not known:",
        "two",
    ),
    _of(
        "wiring",
        "a link before a sensor",
        "        if at_once:\n            yield Departure(place",
        "        if False:\n            yield Departure(place",
        "two",
    ),
    _of(
        "wiring",
        "quantization of links",
        "if isinstance(link, PacketLink) and link.quantization:",
        "if False:",
        "any",
        "two",
    ),
    _of(
        "wiring",
        "extrapolated values",
        '_POLICIES = ("hold", "previous", "midpoint")',
        '_POLICIES = ("hold", "previous", "midpoint", "linear")',
        "any",
        "two",
    ),
    _of(
        "wiring",
        "values by another way than their stamp",
        "if (found.link, found.policy) != (stamped.link, stamped.policy):",
        "if False:",
        "two",
    ),
    _of(
        "wiring",
        "disturbances that follow the loop",
        "if isinstance(connection, Connection) and connection.source.component in moved:",
        "if False:",
        "any",
    ),
    # ---- parameters
    _of(
        "parameters",
        "any number of a plant",
        "    found += differences_from(equations, own)\n",
        "",
        "any",
    ),
    _of(
        "parameters",
        "any delay of a plant",
        "    found += [Difference(*one) for one in covers_plant_delays(design, delays, own)]\n",
        "",
        "exact",
        "upto",
    ),
    _of(
        "parameters",
        "another controller",
        "    return differences_from(designed, own)\n\n\ndef _of_note",
        "    return []\n\n\ndef _of_note",
        "inside",
        "packed",
    ),
    _of(
        "parameters",
        "another thrust map",
        "        designed |= thrust_map_values(problem.vehicle)\n",
        "        pass\n",
        "station",
    ),
    _of(
        "parameters",
        "any noise",
        "if noise is None or not noise <= size * (1 + 1e-12):",
        "if noise is None:",
        "one",
        "two",
    ),
    _of("parameters", "any bias", "            if bias != 0:\n", "            if False:\n", "one"),
    # ---- the law
    _of(
        "law_measures",
        "values that were altered on their way",
        "            (DELIVERED, delivery_law(wiring.feedback_connections(), altered=altered)),\n",
        "",
        "any",
        "two",
    ),
    _of(
        "law_measures",
        "another plant, or a coarse one",
        "            (PLANT, plant_law(problem, loop.plant, of_plant)),\n",
        "",
        "stiff",
    ),
    _of(
        "law_measures",
        "measurements that are not of the plant",
        "            energy, found[MEASURED] = self.noise.result(run)\n",
        "            energy, found[MEASURED] = self.noise.result(run).energy, []\n",
        "one",
        "two",
    ),
    _of(
        "law_measures",
        "commands that are not K x",
        "            self._laws.append((CONTROLLER, feedback_law(loop, design, problem, "
        "of_controller)))\n",
        "            pass\n",
        "any",
        "packed",
    ),
    _of(
        "law_measures",
        "commands that are not K times the estimate",
        "self._laws += [(CONTROLLER, law), (CONTROLLER, estimate_law(loop, design))]",
        "self._laws += [(CONTROLLER, estimate_law(loop, design))]",
        "two",
        "inside",
    ),
    _of(
        "step_law",
        "a coarse integration",
        "_SHARE = 1e-2",
        "_SHARE = 1e6",
        "stiff",
    ),
    # ---- the verdict
    _of(
        "verdict",
        "states outside the envelope",
        "        if not share <= 1.0:\n",
        "        if not share <= 1e9:\n",
        "station",
    ),
    _of(
        "verdict",
        "commands at their limits",
        "[words] if run.limits_reached else []",
        "[]",
        "limited",
        "station",
    ),
    _of(
        "verdict",
        "what events set",
        "list(_set(compared.wiring, run.altered))",
        "[]",
        "any",
        "two",
    ),
    _of(
        "verdict",
        "commands that the observer does not know",
        "        if run.commands_known is not True:\n",
        "        if False:\n",
        "played",
        "two",
    ),
    _of(
        "verdict",
        "other connections",
        'found["loop_as_designed"] = list(compared.departures)',
        'found["loop_as_designed"] = []',
        "any",
        "two",
    ),
    _of(
        "verdict",
        "another plant",
        'found["plant_as_designed"] = _differ(compared, compared.loop.plant)',
        'found["plant_as_designed"] = []',
        "any",
        "upto",
    ),
)
"""Each would make some run claim what its proof does not cover."""
