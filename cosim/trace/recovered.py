"""What a recovered file says of itself: what was lost, and which of its messages may be wrong.

It is the record `cosim.recovered`. Each recovery adds one.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from cosim.trace.rows import layout
from cosim.trace.rows.layout import parsed_json

_MOST_TOPICS = 4


@dataclass(frozen=True)
class Recovered:
    """What was lost of a file, and what in it is suspect.

    Attributes
    ----------
    lost_messages : number, None if unknown.
    lost_bytes : bytes of the damaged file that could not be used.
    damage : places and reasons.
    suspect_messages : number of messages that are marked: their chunk is damaged.
    suspect : of each damaged chunk or attachment what was kept: `messages` (numbers of the first
        and behind the last, in file order), `topics` (number of messages of each), `log_ns` (least
        and greatest), or `attachment`; and `why`.
    """

    lost_messages: int | None
    lost_bytes: int
    damage: str
    suspect_messages: int = 0
    suspect: tuple[dict[str, Any], ...] = ()

    @classmethod
    def of(cls, metadata: Iterable[tuple[str, Mapping[str, str]]]) -> Recovered | None:
        """Return what the records of a file say together; None without one."""
        each = [cls._read(entries) for name, entries in metadata if name == layout.RECOVERED]
        if not each:
            return None
        lost = [one.lost_messages for one in each]
        return cls(
            sum(number for number in lost if number is not None) if None not in lost else None,
            sum(one.lost_bytes for one in each),
            "; ".join(one.damage for one in each if one.damage),
            sum(one.suspect_messages for one in each),
            tuple(part for one in each for part in one.suspect),
        )

    @classmethod
    def _read(cls, entries: Mapping[str, str]) -> Recovered:
        def number(key: str) -> int | None:
            text = entries.get(f"host.{key}", "")
            return int(text) if text.isascii() and text.isdecimal() else None

        listed = parsed_json(entries.get("host.suspect", "[]"))
        parts = listed if isinstance(listed, list) else []
        return cls(
            number("lost_messages"),
            number("lost_bytes") or 0,
            entries.get("host.damage", ""),
            number("suspect_messages") or 0,
            tuple(part for part in parts if isinstance(part, dict)),
        )

    def entries(self) -> dict[str, str]:
        """Return the entries of the record."""
        lost = self.lost_messages
        return {
            "host.lost_bytes": str(self.lost_bytes),
            "host.lost_messages": "unknown" if lost is None else str(lost),
            "host.damage": self.damage,
            "host.suspect_messages": str(self.suspect_messages),
            "host.suspect": json.dumps(self.suspect),
        }

    def to_json(self) -> dict[str, Any]:
        """Return all fields, and the words, as JSON values."""
        return {**asdict(self), "words": self.words}

    @property
    def marked(self) -> bool:
        """Whether anything in the file is suspect."""
        return bool(self.suspect_messages or self.suspect)

    @property
    def words(self) -> str:
        """Say what is marked, and what was lost."""
        lost = self.lost_messages
        missing = "an unknown number of messages" if lost is None else f"{lost} messages"
        text = f"Recovered from a damaged file: {missing} lost"
        if not self.marked:
            return f"{text}, none marked."
        attached = sum("attachment" in part for part in self.suspect)
        more = f", {attached} attachments" if attached else ""
        return f"{text}; {self.suspect_messages} marked, which may be wrong{self._where()}{more}."

    def _where(self) -> str:
        """Name the topics and the times of what is marked."""
        topics: dict[str, int] = {}
        times: list[int] = []
        for part in self.suspect:
            counts, span = part.get("topics"), part.get("log_ns")
            for topic, number in counts.items() if isinstance(counts, dict) else ():
                if isinstance(number, int):
                    topics[str(topic)] = topics.get(str(topic), 0) + number
            if isinstance(span, list) and all(isinstance(at, int) for at in span):
                times += span
        if not topics or not times:
            return ""
        most = sorted(topics.items(), key=lambda each: (-each[1], each[0]))[:_MOST_TOPICS]
        named = [f"{topic} {number}" for topic, number in most]
        if len(topics) > _MOST_TOPICS:
            named.append(f"{len(topics) - _MOST_TOPICS} more topics")
        span_s = f"{min(times) / 1e9:g} s to {max(times) / 1e9:g} s"
        return f" ({', '.join(named)}; {span_s})"
