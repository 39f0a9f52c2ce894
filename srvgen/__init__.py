"""ROS 2 interface definitions in Python: parse them, load them as classes, generate packages."""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # importing typing would cost more than all the rest of this file
if TYPE_CHECKING:
    from ._runtime import FieldError
    from .cdr import CdrError, from_cdr, to_cdr
    from .convert import from_builtins, to_builtins
    from .errors import DefinitionError
    from .importer import install_import_hook
    from .loader import define, load, type_hash
    from .parser import parse_action, parse_msg, parse_srv

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
    "CdrError": "cdr",
    "DefinitionError": "errors",
    "FieldError": "_runtime",
    "define": "loader",
    "from_builtins": "convert",
    "from_cdr": "cdr",
    "install_import_hook": "importer",
    "load": "loader",
    "parse_action": "parser",
    "parse_msg": "parser",
    "parse_srv": "parser",
    "to_builtins": "convert",
    "to_cdr": "cdr",
    "type_hash": "loader",
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
