"""ROS 2 interface definitions in Python: parse them, load them as classes, generate packages.

Start with `parser`, which reads a definition, and `classes.loader`, which makes classes from it.
This module only exports the public names, and imports a name when a program first uses it. Nothing
in this package imports taskrpc.
"""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # importing typing would cost more than all the rest of this file
if TYPE_CHECKING:
    from ._runtime import FieldError
    from .cdr.messages import CdrError, from_cdr, to_cdr
    from .classes.importer import install_import_hook
    from .classes.loader import define, type_hash
    from .convert import from_builtins, to_builtins
    from .errors import DefinitionError
    from .parser import parse_action, parse_msg, parse_srv
    from .stubs import load  # for a type that comes with srvgen, its class; otherwise Any

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

EXPORTS = {
    "CdrError": "cdr.messages",
    "DefinitionError": "errors",
    "FieldError": "_runtime",
    "define": "classes.loader",
    "from_builtins": "convert",
    "from_cdr": "cdr.messages",
    "install_import_hook": "classes.importer",
    "load": "classes.loader",
    "parse_action": "parser",
    "parse_msg": "parser",
    "parse_srv": "parser",
    "to_builtins": "convert",
    "to_cdr": "cdr.messages",
    "type_hash": "classes.loader",
}
"""The module that defines each public name.

A name is imported when it is first used: a program with generated classes loads no parser.
"""


if not TYPE_CHECKING:  # or type checkers would accept every missing name as Any

    def __getattr__(name):
        if name not in EXPORTS:
            raise AttributeError(f"module 'srvgen' has no attribute {name!r}")
        value = getattr(import_module(f".{EXPORTS[name]}", __name__), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
