"""Descriptions of fields: the strings that stand below them in the source of their class.

They are read when a schema or a page is made, so that importing a class costs nothing for them.
"""

from __future__ import annotations

import ast
import inspect
import sys
from functools import cache
from typing import Any


def field_docs(cls: type) -> dict[str, str]:
    """Return the description of each field of a class and its bases, on one line each.

    A field without a string below it is absent, and so are the fields of a class that was made
    without source text.
    """
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        found |= _of_module(base.__module__).get(base.__qualname__, {})
    return found


def with_field_docs(cls: Any, core: Any, handler: Any) -> Any:
    """Return the JSON schema of a pydantic model, each key with the string below its field.

    To be called by its `__get_pydantic_json_schema__`. A description of its own stays.
    """
    schema = handler(core)
    keys = handler.resolve_ref_schema(schema).get("properties", {})
    docs = field_docs(cls)
    for name, field in cls.model_fields.items():
        for key in {name, field.alias} & keys.keys():
            if name in docs:
                keys[key].setdefault("description", docs[name])
    return schema


@cache
def _of_module(name: str) -> dict[str, dict[str, str]]:
    """Return the descriptions of the fields of each class of a module."""
    try:
        tree = ast.parse(inspect.getsource(sys.modules[name]))
    except (OSError, TypeError):  # a module of the interpreter, or one without source
        return {}
    return {node.name: _of_class(node) for node in tree.body if isinstance(node, ast.ClassDef)}


def _of_class(node: ast.ClassDef) -> dict[str, str]:
    found = {}
    for field, below in zip(node.body, node.body[1:], strict=False):
        match field, below:
            case (
                ast.AnnAssign(target=ast.Name(id=name)),
                ast.Expr(value=ast.Constant(value=str(text))),
            ):
                found[name] = " ".join(text.split())
    return found
