"""ROS 2 interface definitions in Python: parse them, load them as classes, generate packages."""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # importing typing would cost more than all the rest of this file
if TYPE_CHECKING:
    from ._runtime import FieldError
    from .cdr.messages import CdrError, from_cdr, to_cdr
    from .classes.importer import install_import_hook
    from .classes.loader import define, load, type_hash
    from .convert import from_builtins, to_builtins
    from .definitions.parser import parse_action, parse_msg, parse_srv
    from .errors import DefinitionError

__all__ = [
    "CdrError",
    "DefinitionError",
    "FieldError",
    "define",
    "from_builtins",
    "from_cdr",
    "install_import_hook",
    "load",
    "parse_action",
    "parse_msg",
    "parse_srv",
    "to_builtins",
    "to_cdr",
    "type_hash",
]

# Each name is imported when it is first asked for: a program that has generated its classes
# beforehand pays for no parser.
_HOMES = {
    "CdrError": "cdr.messages",
    "DefinitionError": "errors",
    "FieldError": "_runtime",
    "define": "classes.loader",
    "from_builtins": "convert",
    "from_cdr": "cdr.messages",
    "install_import_hook": "classes.importer",
    "load": "classes.loader",
    "parse_action": "definitions.parser",
    "parse_msg": "definitions.parser",
    "parse_srv": "definitions.parser",
    "to_builtins": "convert",
    "to_cdr": "cdr.messages",
    "type_hash": "classes.loader",
}


if not TYPE_CHECKING:  # or type checkers would accept every missing name as Any

    def __getattr__(name):
        if name not in _HOMES:
            raise AttributeError(f"module 'srvgen' has no attribute {name!r}")
        value = getattr(import_module(f".{_HOMES[name]}", __name__), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
