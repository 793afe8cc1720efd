"""How parts of an outcome are read from a file: what is absent or of another form has its default.

Files of older versions and of other tools are read too; a part that this program makes is
validated as it is.
"""

from __future__ import annotations

from typing import Any, Final

from pydantic import (
    BeforeValidator,
    ConfigDict,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)
from pydantic_core import to_jsonable_python

BY_EITHER_NAME: Final = ConfigDict(populate_by_name=True)
"""Of a class with a field that has another name in files."""
FROM_FILE: Final = {"from_file": True}
"""Context of a validation that a file is read with."""


def or_else(default: Any) -> WrapValidator:
    """Return a mark for a type: what a file has in another form is `default`."""

    def read(value: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
        try:
            return handler(value)
        except ValidationError:
            if info.context != FROM_FILE:
                raise
            return default

    return WrapValidator(read)


def as_text() -> BeforeValidator:
    """Return a mark for a text: what a file has in its place is read as its text."""

    def read(value: Any, info: ValidationInfo) -> Any:
        return str(value) if info.context == FROM_FILE and value is not None else value

    return BeforeValidator(read)


def each_valid(of: type) -> BeforeValidator:
    """Return a mark for a sequence: of a file's list, entries of another form are left out."""
    adapter: TypeAdapter[Any] = TypeAdapter(of)

    def read(value: Any, info: ValidationInfo) -> Any:
        if info.context != FROM_FILE:
            return value
        found = []
        for item in value if isinstance(value, list) else ():
            try:
                found.append(adapter.validate_python(item, context=FROM_FILE))
            except ValidationError:
                continue
        return tuple(found)

    return BeforeValidator(read)


class AsJson:
    """Base of the parts of an outcome: each is an object of JSON values."""

    __slots__ = ()

    def to_json(self) -> dict[str, Any]:
        """Return all fields as JSON values, by their names in files."""
        found: dict[str, Any] = to_jsonable_python(self, by_alias=True)
        return found
