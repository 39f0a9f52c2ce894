"""Recognises the same program with other names, comments, docstrings and layout."""

from __future__ import annotations

import ast
import warnings

_NAMES = ("id", "arg", "name", "attr", "asname", "module", "rest")
"""The fields of Python's syntax trees in which a name is."""
_LISTS = ("names", "kwd_attrs")
"""The fields with several names."""
_LARGEST = 2**18


def structure(source: bytes) -> bytes:
    """Return the same for programs that differ in names, comments and layout only.

    Each name becomes the number of its first place, so two names stay two names. What is not
    Python stays as it is.
    """
    if len(source) > _LARGEST:
        return source
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tree = ast.parse(source)
        _Numbers().visit(tree)
        return ast.dump(tree).encode()
    except (SyntaxError, ValueError, RecursionError, MemoryError, OverflowError):
        return source


class _Numbers(ast.NodeVisitor):
    """Replaces the names in a tree by numbers, and removes docstrings."""

    def __init__(self) -> None:
        self._numbers: dict[tuple[bool, str], str] = {}
        """For each name, first whether it is that of an attribute or of a keyword argument."""

    def generic_visit(self, node: ast.AST) -> None:
        """Number the names of a node, then those below it."""
        body = getattr(node, "body", None)
        if isinstance(body, list) and body and _is_text(body[0]):
            del body[0]
        for field in _NAMES:
            name = getattr(node, field, None)
            if isinstance(name, str):
                is_of_object = field == "attr" or isinstance(node, ast.keyword)
                setattr(node, field, self._number(is_of_object, name))
        for field in _LISTS:
            names = getattr(node, field, None)
            if isinstance(names, list) and all(isinstance(each, str) for each in names):
                setattr(node, field, [self._number(False, each) for each in names])
        super().generic_visit(node)

    def _number(self, is_of_object: bool, name: str) -> str:
        return self._numbers.setdefault((is_of_object, name), str(len(self._numbers)))


def _is_text(statement: ast.AST) -> bool:
    """Whether a statement is only a text, such as a docstring."""
    return (
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    )
