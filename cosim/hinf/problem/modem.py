"""How old messages become behind a modem: from what its data sheet says to the age to design for.

A sender has one slot in every `slot_s`. Its message takes `sending` to leave and `travel` to
arrive, so that it is used at the age `least` = sending + travel + other; from then on the age
grows at rate one until the next message that is not lost:

    greatest = least + (losses in a row + 1) slot

That is what a design calls a sampled age: least_age = least, d = greatest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from cosim.core import InputError

SOUND_SPEED = 1500.0
"""Of sea water, rounded [m/s]."""
PER_HOUR = 1.0
"""Longer runs of losses that are accepted in an hour, on average, where none is given."""
_MOST_LOSSES = 1000


@dataclass(frozen=True)
class Modem:
    """What is known of the way a measurement takes.

    Parameters
    ----------
    bit_rate : [bit/s].
    packet_bytes : size of a message with all its headers [byte].
    range_m : greatest distance between sender and receiver [m].
    slot_s : time from one message to the next [s]; None: as soon as the one before has left.
    loss : probability that a message is lost, independent of the others, from 0 to below 1.
    losses : losses in a row to bear; None: the least number that is exceeded at most `PER_HOUR`
        times in an hour.
    other_s : what else makes every message older, such as processing and the way of the
        command [s].
    sound_speed : [m/s]; 3e8 for radio.

    Raises
    ------
    InputError : a number out of its range, or a slot too short for a message.
    """

    bit_rate: float
    packet_bytes: int
    range_m: float
    slot_s: float | None = None
    loss: float = 0.0
    losses: int | None = None
    other_s: float = 0.0
    sound_speed: float = SOUND_SPEED

    def __post_init__(self) -> None:
        for name, value, positive in (
            ("bit_rate", self.bit_rate, True),
            ("packet_bytes", self.packet_bytes, True),
            ("range_m", self.range_m, False),
            ("other_s", self.other_s, False),
            ("sound_speed", self.sound_speed, True),
            ("slot_s", self.slot, True),
        ):
            if not (math.isfinite(value) and (value > 0.0 if positive else value >= 0.0)):
                raise InputError(
                    f"not a {'positive' if positive else 'sensible'} number",
                    where=name,
                    expected="a finite number" + (" above 0" if positive else ", 0 or above"),
                    got=repr(value),
                )
        if not 0.0 <= self.loss < 1.0:
            raise InputError(
                "not the probability of a loss",
                where="loss",
                expected="from 0 to below 1",
                got=repr(self.loss),
                hint="a probability: 0.05 for 5 %",
            )
        if self.losses is not None and not 0 <= self.losses <= _MOST_LOSSES:
            raise InputError(
                "not a number of losses",
                where="losses",
                expected=f"0 to {_MOST_LOSSES}",
                got=repr(self.losses),
            )
        if self.slot < self.sending:
            raise InputError(
                "a message does not fit into its slot",
                where="slot_s",
                expected=f"{self.sending:.6g} s or more: {self._sending_text}",
                got=f"{self.slot:g} s",
                hint="a longer slot, a smaller packet or a higher bit rate",
            )

    @property
    def sending(self) -> float:
        """Time that a message takes to leave [s]."""
        return 8 * self.packet_bytes / self.bit_rate

    @property
    def travel(self) -> float:
        """Time that it takes to arrive [s]."""
        return self.range_m / self.sound_speed

    @property
    def slot(self) -> float:
        """Time from one message to the next [s]."""
        return self.sending if self.slot_s is None else self.slot_s

    @property
    def losses_borne(self) -> int:
        """How many losses in a row the greatest age allows for.

        Raises
        ------
        InputError : the loss is so high that no reasonable number is enough.
        """
        if self.losses is not None:
            return self.losses
        if self.loss == 0.0:
            return 0
        # longer runs an hour: (1 - p) p^(k + 1) per message
        messages = 3600.0 / self.slot
        enough = math.log(PER_HOUR / (messages * (1.0 - self.loss))) / math.log(self.loss) - 1.0
        if enough > _MOST_LOSSES:
            raise InputError(
                "too many losses to bear",
                where="loss",
                expected=f"at most {_MOST_LOSSES} in a row",
                got=f"{self.loss:g}",
                hint="give the number in a row yourself: losses",
            )
        return max(math.ceil(enough), 0)

    @property
    def longer_runs_per_hour(self) -> float:
        """How often in an hour, on average, more messages in a row are lost."""
        return 3600.0 / self.slot * (1.0 - self.loss) * self.loss ** (self.losses_borne + 1)

    @property
    def least(self) -> float:
        """Age of a measurement when it comes into use [s]."""
        return self.sending + self.travel + self.other_s

    @property
    def greatest(self) -> float:
        """Age when the next one comes into use, after the losses that are borne [s]."""
        return self.least + (self.losses_borne + 1) * self.slot

    @property
    def _sending_text(self) -> str:
        return f"8 x {self.packet_bytes} byte / {self.bit_rate:g} bit/s"

    def arithmetic(self) -> list[tuple[str, float, str]]:
        """Return how the ages come about: (what, seconds, of what it is made), line by line."""
        rows = [
            ("sending", self.sending, self._sending_text),
            ("travel", self.travel, f"{self.range_m:g} m / {self.sound_speed:g} m/s"),
        ]
        if self.other_s:
            rows.append(("other", self.other_s, "as given"))
        k = self.losses_borne
        why = "as given" if self.losses is not None else "no loss"
        if self.loss and self.losses is None:
            why = f"more than {k} in a row {self.longer_runs_per_hour:.2g} times an hour"
            why += f" at a loss of {self.loss:g}"
        slot = "one message after the other" if self.slot_s is None else "as given"
        return [
            *rows,
            ("least age", self.least, " + ".join(name for name, _, _ in rows)),
            ("slot", self.slot, slot),
            ("losses", (k + 1) * self.slot, f"({k} in a row + 1) x slot; {why}"),
            ("greatest age", self.greatest, "least age + losses"),
        ]
