"""JSON values that cannot be changed: dictionaries and lists that refuse to, through and through.

They are dictionaries and lists to `json`, to `==` and to whoever reads them, and hashable. What
makes a new one of them gives a plain dictionary or list: `{**frozen, "key": 1}`, `frozen | more`.
"""

from __future__ import annotations

from typing import Any, NoReturn, Self


def frozen_json(value: Any) -> Any:
    """Return JSON values that cannot be changed, equal to these; tuples are lists.

    Raises
    ------
    TypeError : not a value of JSON: an array, an object.
    """
    if value is None or isinstance(value, (str, bool, int, float, FrozenDict, FrozenList)):
        return value
    if isinstance(value, dict):
        return FrozenDict(value)
    if isinstance(value, (list, tuple)):
        return FrozenList(value)
    raise TypeError(f"expected a value of JSON, got {type(value).__name__}")


def _refuse(*_arguments: Any, **_more: Any) -> NoReturn:
    raise TypeError(
        "a certificate cannot be changed: it would no longer be what was proved. Change a copy, "
        "json.loads(json.dumps(certificate)), and check it"
    )


class _Frozen:
    """What frozen dictionaries and lists share."""

    __setitem__ = __delitem__ = pop = clear = _refuse

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, _memo: dict[int, Any]) -> Self:
        return self


class FrozenDict(_Frozen, dict[str, Any]):
    """A dictionary of JSON that cannot be changed."""

    def __init__(self, values: Any = ()) -> None:
        if self:
            _refuse()
        super().__init__((key, frozen_json(value)) for key, value in dict(values).items())

    update = setdefault = popitem = __ior__ = _refuse

    def __hash__(self) -> int:  # type: ignore[override]  # it cannot change
        return hash(frozenset(self.items()))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (dict(self),)


class FrozenList(_Frozen, list[Any]):
    """A list of JSON that cannot be changed."""

    def __init__(self, values: Any = ()) -> None:
        if self:
            _refuse()
        super().__init__(map(frozen_json, values))

    append = extend = insert = remove = sort = reverse = _refuse
    __iadd__ = __imul__ = _refuse

    def __hash__(self) -> int:  # type: ignore[override]  # it cannot change
        return hash(tuple(self))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (list(self),)
