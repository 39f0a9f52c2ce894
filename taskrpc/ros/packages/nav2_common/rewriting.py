"""Changes the content of a parameter file; pure functions of the loaded YAML.

A path is the names of nested keys with dots between them, `amcl.ros__parameters.use_sim_time`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

_PARAMETERS = "ros__parameters"


def rewritten(
    data: Any,
    parameters: Mapping[str, str],
    *,
    keys: Mapping[str, str],
    values: Mapping[str, str],
    converts_numbers: bool,
) -> Any:
    """Return the content with other values and keys.

    Args:
        data: the content of a YAML file; it is changed.
        parameters: new values by name or path. A path with `ros__parameters` that does not exist
            is added; a name changes the parameter of all nodes.
        keys: new names of keys, by their old names.
        values: new values, by their old values.
        converts_numbers: turn new values such as `"3"` into numbers.
    """
    data = {} if data is None else data
    for holder, key, path in list(_entries(data, "")):
        wanted = parameters.get(path, parameters.get(str(key)))
        if wanted is None and isinstance(holder[key], str):
            wanted = values.get(holder[key])
        if wanted is not None:
            holder[key] = converted(wanted, converts_numbers)
    known = {path for _, _, path in _entries(data, "")}
    for path, value in parameters.items():
        if path not in known and _PARAMETERS in path.split("."):
            _add(data, path.split("."), converted(value, converts_numbers))
    return _renamed(data, keys)


def converted(text: str, converts_numbers: bool) -> Any:
    """Turn a text into a truth value, and into a number if that is wanted."""
    if converts_numbers:
        try:
            return float(text) if "." in text else int(text)
        except ValueError:
            pass
    return {"true": True, "false": False}.get(text.lower(), text)


def _entries(data: Any, path: str) -> Iterator[tuple[Any, Any, str]]:
    """Each key and each index, with the dict or list that has it, and its path."""
    if not isinstance(data, (dict, list)):
        return
    for key, value in list(data.items() if isinstance(data, dict) else enumerate(data)):
        inner = f"{path}.{key}" if path else str(key)
        yield from _entries(value, inner)
        yield data, key, inner


def _add(data: Any, names: list[str], value: Any) -> None:
    *outer, last = names
    for name in outer:
        data = data.setdefault(name, {})
    data[last] = value


def _renamed(data: Any, keys: Mapping[str, str]) -> Any:
    if not keys or not isinstance(data, dict):
        return data
    return {keys.get(key, key): _renamed(value, keys) for key, value in data.items()}
