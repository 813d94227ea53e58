"""TOML files to frozen structs: the one place where a bad file becomes a clear error.

`read_toml(path, type)` decodes a file with msgspec. Whatever is wrong with it (not TOML, a missing, unknown or
misspelt key, a wrong type, a value out of range, NaN, an infinity where none makes sense) is a ConfigurationError that
names the file, the dotted key, the value and what is accepted. Ranges are those of `msgspec.Meta` in the struct; a rule
between two fields is a `FieldError` raised in the struct's `__post_init__`. Units are in the key names (design 7).
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
from msgspec import inspect

from drivers.errors import ConfigurationError

T = TypeVar("T")

PositiveOrInfinite = Annotated[float, msgspec.Meta(gt=0, extra={"infinite": True})]
"""A number > 0; `inf` is meant (a rigid part). Every other float field must be finite."""

MISSING = "(missing)"


class FieldError(ValueError):
    """For `__post_init__`: field `key` breaks a rule between fields; `accepted` says the rule."""

    def __init__(self, key: str, accepted: str) -> None:
        super().__init__(f"{key}: expected {accepted}")
        self.key = key
        self.accepted = accepted


def read_toml(path: str | Path, type_: type[T]) -> T:
    """Decode the TOML file at `path` as the msgspec struct `type_`. Errors: ConfigurationError."""
    return from_document(load_document(path), type_, path)


def load_document(path: str | Path) -> dict[str, Any]:
    """The file as nested dicts; not readable or not TOML: ConfigurationError."""
    try:
        return tomllib.loads(Path(path).read_bytes().decode("utf-8"))
    except OSError as error:
        raise ConfigurationError(path, "(file)", error.strerror or str(error), "a readable TOML file") from error
    except UnicodeDecodeError as error:
        raise ConfigurationError(path, "(file)", f"byte {error.start} is not UTF-8", "UTF-8 text") from error
    except tomllib.TOMLDecodeError as error:
        raise ConfigurationError(path, "(file)", str(error), "valid TOML") from error


def from_document(
    document: Mapping[str, Any],
    type_: type[T],
    file: str | Path,
    *,
    written_as: Callable[[str], str] = lambda key: key,
) -> T:
    """Convert nested dicts to `type_`; `written_as` maps a dotted key back to how the file's author wrote it."""
    description = inspect.type_info(type_)
    _refuse_not_finite(document, "", description, file, written_as)
    try:
        return msgspec.convert(document, type_)
    except msgspec.ValidationError as error:
        raise _explain(error, document, description, file, written_as) from error


def merged(base: Mapping[str, Any], override: Mapping[str, Any]) -> dict[str, Any]:
    """`base` with the keys of `override` laid over it, table by table; a table of another `kind` replaces the whole."""
    result = dict(base)
    for key, value in override.items():
        below = result.get(key)
        if isinstance(below, Mapping) and isinstance(value, Mapping):
            same_kind = value.get("kind", below.get("kind")) == below.get("kind")
            result[key] = merged(below, value) if same_kind else dict(value)
        else:
            result[key] = value
    return result


def _explain(
    error: msgspec.ValidationError,
    document: Mapping[str, Any],
    description: inspect.Type,
    file: str | Path,
    written_as: Callable[[str], str],
) -> ConfigurationError:
    text, _, path = str(error).partition(" - at `$")
    key = path.rstrip("`").lstrip(".")
    cause = error.__cause__
    if isinstance(cause, FieldError):
        key = f"{key}.{cause.key}".lstrip(".")
        return ConfigurationError(file, written_as(key), _value_at(document, key), cause.accepted)
    if match := re.fullmatch(r"Object missing required field `(.+)`", text):
        key = f"{key}.{match[1]}".lstrip(".")
        return ConfigurationError(file, written_as(key), MISSING, _accepted(_type_at(description, document, key)))
    if match := re.fullmatch(r"Object contains unknown field `(.+)`", text):
        keys = _keys(_type_at(description, document, key))
        key = f"{key}.{match[1]}".lstrip(".")
        return ConfigurationError(file, written_as(key), _value_at(document, key), f"no such key, but one of {keys}")
    accepted = _accepted(_type_at(description, document, key)) or text
    return ConfigurationError(file, written_as(key or "(file)"), _value_at(document, key), accepted)


def _steps(key: str) -> list[str | int]:
    """'a.b[1].c' as ['a', 'b', 1, 'c']."""
    return [int(index) if index else name for name, index in re.findall(r"([^.\[\]]+(?![^\[]*\]))|\[(\d+)\]", key)]


def _value_at(document: Any, key: str) -> Any:
    for step in _steps(key):
        try:
            document = document[step]
        except (KeyError, IndexError, TypeError):
            return MISSING
    return document


def _type_at(description: inspect.Type, document: Any, key: str) -> inspect.Type | None:
    """Type that the struct description gives to the dotted `key`; unions are resolved by the file's own tag."""
    current: inspect.Type | None = _resolved(description, document)
    for step in _steps(key):
        if isinstance(current, inspect.StructType):
            fields = {field.encode_name: field.type for field in current.fields}
            if current.tag_field == step:
                return inspect.LiteralType(values=(str(current.tag),))
            current = fields.get(str(step))
        elif isinstance(current, inspect.DictType):
            current = current.value_type
        elif isinstance(current, inspect.TupleType) and isinstance(step, int) and step < len(current.item_types):
            current = current.item_types[step]
        elif isinstance(current, inspect.ListType | inspect.VarTupleType):
            current = current.item_type
        elif isinstance(current, inspect.UnionType):  # the tag itself is missing or wrong
            return inspect.LiteralType(values=tuple(str(tag) for tag in _tags(current)))
        else:
            return None
        try:
            document = document[step]
        except (KeyError, IndexError, TypeError):
            document = None
        current = _resolved(current, document) if current is not None else None
    return current


def _tags(union: inspect.UnionType) -> list[object]:
    return [item.tag for item in union.types if isinstance(item, inspect.StructType)]


def _resolved(description: inspect.Type, document: Any) -> inspect.Type:
    while isinstance(description, inspect.Metadata):
        if (description.extra or {}).get("infinite"):
            return description
        description = description.type
    if isinstance(description, inspect.UnionType):
        structs = [item for item in description.types if isinstance(item, inspect.StructType)]
        for item in structs:
            tagged = item.tag_field and isinstance(document, Mapping) and document.get(item.tag_field) == item.tag
            if tagged or (len(structs) == 1 and not item.tag_field):
                return item
        if not structs:
            others = [item for item in description.types if not isinstance(item, inspect.NoneType)]
            return _resolved(others[0], document) if len(others) == 1 else description
    return description


def _keys(description: inspect.Type | None) -> str:
    if not isinstance(description, inspect.StructType):
        return "the keys in the documentation"
    names = [field.encode_name for field in description.fields]
    return ", ".join([description.tag_field, *names] if description.tag_field else names)


def _accepted(description: inspect.Type | None) -> str:
    """What a field accepts, in words: 'a number > 0 and ≤ 1'."""
    if isinstance(description, inspect.Metadata):
        return f"{_accepted(description.type)} or inf"
    if isinstance(description, inspect.FloatType | inspect.IntType):
        signs = (("gt", ">"), ("ge", "≥"), ("lt", "<"), ("le", "≤"))
        limits = [
            f"{sign} {getattr(description, name):g}" for name, sign in signs if getattr(description, name) is not None
        ]
        kind = "a finite number" if isinstance(description, inspect.FloatType) else "a whole number"
        return f"{kind} {' and '.join(limits)}".rstrip()
    if isinstance(description, inspect.StrType):
        pattern = f" matching {description.pattern}" if description.pattern else ""
        return f"a text{pattern}" + (f" of at least {description.min_length} letters" if description.min_length else "")
    if isinstance(description, inspect.BoolType):
        return "true or false"
    if isinstance(description, inspect.LiteralType):
        return "one of " + ", ".join(repr(value) for value in description.values)
    if isinstance(description, inspect.EnumType):
        return "one of " + ", ".join(repr(item.value) for item in description.cls)
    if isinstance(description, inspect.TupleType):
        items = sorted({_accepted(_resolved(item, None)) for item in description.item_types})
        return f"an array of {len(description.item_types)}, each {' or '.join(items)}"
    if isinstance(description, inspect.ListType | inspect.VarTupleType):
        return f"an array, each {_accepted(_resolved(description.item_type, None))}"
    if isinstance(description, inspect.StructType):
        return f"a table with the keys {_keys(description)}"
    if isinstance(description, inspect.UnionType):
        return "a table with kind one of " + ", ".join(repr(tag) for tag in _tags(description))
    return ""


def _refuse_not_finite(
    value: Any, key: str, description: inspect.Type, file: str | Path, written_as: Callable[[str], str]
) -> None:
    document = value
    pending: list[tuple[str, Any]] = [(key, value)]
    while pending:
        key, value = pending.pop()
        if isinstance(value, Mapping):
            pending += [(f"{key}.{name}".lstrip("."), item) for name, item in value.items()]
        elif isinstance(value, list | tuple):
            pending += [(f"{key}[{index}]", item) for index, item in enumerate(value)]
        elif isinstance(value, float) and not math.isfinite(value):
            found = _type_at(description, document, key)
            if value != math.inf or not isinstance(found, inspect.Metadata):
                raise ConfigurationError(file, written_as(key), value, _accepted(found) or "a finite number")
