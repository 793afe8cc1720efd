"""A table of a file as a pydantic model, and the types of values that every kind of file has."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, TypeVar

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from cosim.core.descriptions import with_field_docs
from cosim.core.origin import KeyPath

Text = Annotated[str, StringConstraints(min_length=1)]
"""A text that is not empty."""
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
"""A finite number > 0."""
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
"""A finite number >= 0."""
Number = Annotated[float, Field(allow_inf_nan=False)]
"""A finite number."""

_NONE: Mapping[str, str] = MappingProxyType({})


class Part(BaseModel):
    """A table of a file; the attributes below are for messages, of the table at the top."""

    # strict: "5.0" is not a number and true is not 1, as in TOML
    # built at first use: most tables are only used as parts of others, which build them again
    model_config = ConfigDict(
        extra="forbid", frozen=True, populate_by_name=True, strict=True, defer_build=True
    )

    meant: ClassVar[Mapping[str, str]] = _NONE
    """Words of other tools, in small letters without punctuation -> the key that is meant.

    One that is meant in a table alone has its first name before it, as "events.start"; a key of
    another table is written with its own, as "log.level".
    """
    examples: ClassVar[Mapping[str, str]] = _NONE
    """Keys -> a value that is allowed, as it is written; "events.delay" of one table alone."""
    described_by: ClassVar[str | None] = None
    """What describes every key of such a file."""
    patterns: ClassVar[Mapping[str, str]] = _NONE
    """Regular expressions of texts -> what they ask for, in words."""
    lists_faults: ClassVar[str | None] = None
    """Command that lists every fault of such a file."""

    @classmethod
    def advice(cls, wrong: str, path: KeyPath, value: Any, data: Any) -> str | None:  # noqa: ARG003 - of those who know more
        """Return what to do about a fault that this kind of file knows; None for any other.

        wrong : pydantic's type of the error. data : the whole file.
        """
        return None

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any, handler: Any) -> Any:
        """Return the JSON schema, in which each key has the string below its field."""
        return with_field_docs(cls, core, handler)


PartType = TypeVar("PartType", bound=Part)
"""The table at the top of a kind of file."""
