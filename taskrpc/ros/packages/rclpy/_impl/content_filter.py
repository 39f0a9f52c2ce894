"""Filters of messages by content: expressions such as `int32_value > %0`, compiled to functions.

The language is the SQL subset of DDS, with the rules of Fast DDS. AND and OR have the same
precedence: conditions are evaluated from left to right. A chain that begins with NOT after an
operator is one operand: `A AND NOT B OR C` means `A AND (NOT B OR C)`.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

Test: TypeAlias = Callable[[Any], bool]
"""Whether a message passes."""

MAX_PARAMETERS = 100
_MAX_NUMBER = 2**64
_TOKEN = re.compile(
    r"""\s*(?:
    (?P<number>[+-]?(?:0[xX][0-9a-fA-F]+|[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?))
    | (?P<text>['`][^'\n]*')
    | (?P<parameter>%[0-9]{1,2})
    | (?P<name>[A-Za-z_][A-Za-z0-9_]*(?:\.[A-Za-z_][A-Za-z0-9_]*)*)
    | (?P<symbol><=|>=|<>|!=|[<>=()])
    )[ \t]*""",
    re.VERBOSE,
)
_WORDS = frozenset({"AND", "OR", "NOT", "BETWEEN", "LIKE", "MATCH"})
_BOOLS = {"TRUE": True, "true": True, "FALSE": False, "false": False}
_COMPARISONS: dict[str, Callable[[Any, Any], bool]] = {
    "=": operator.eq,
    "<>": operator.ne,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_MIRRORED = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}
_WILDCARDS = {"%": ".*", "*": ".*", "_": ".", "?": "."}


class FilterError(ValueError):
    """An expression that cannot be a filter of this message type; the text says where and why."""


class _Token(NamedTuple):
    kind: str
    text: str
    start: int


class _Operand(NamedTuple):
    value: Callable[[Any], Any]
    """Returns the value of the operand in a message."""
    kind: type
    """`str`, or `float` for numbers and booleans."""
    is_field: bool
    text: str


def compile_filter(expression: str, parameters: Sequence[str], message_type: Any) -> Test:
    """Return the function that tells whether a message passes.

    Raises FilterError for an expression or a parameter that the message type does not allow.
    """
    if len(parameters) > MAX_PARAMETERS:
        raise FilterError(
            f"expected at most {MAX_PARAMETERS} expression parameters, got {len(parameters)}"
        )
    return _Parser(expression, parameters, message_type()).parse()


class _Parser:
    def __init__(self, expression: str, parameters: Sequence[str], example: Any) -> None:
        self._expression = expression
        self._parameters = parameters
        self._example = example
        """A message with default values: its fields have the types of all messages."""
        self._tokens = _tokens(expression)
        self._at = 0

    def parse(self) -> Test:
        test = self._chain()
        if self._peek().kind != "end":
            raise self._error("expected AND, OR or the end")
        return test

    def _chain(self) -> Test:
        test = self._term()
        while self._peek().kind in ("AND", "OR"):
            join = _both if self._next().kind == "AND" else _either
            test = join(test, self._chain() if self._peek().kind == "NOT" else self._term())
        return test

    def _term(self) -> Test:
        if self._accept("NOT"):
            return _negated(self._term())
        if self._accept("("):
            test = self._chain()
            self._expect(")")
            return test
        return self._predicate()

    def _predicate(self) -> Test:
        left = self._operand()
        if left.is_field and self._peek().kind in ("NOT", "BETWEEN"):
            return self._between(left)
        found = self._next()
        if found.kind not in (*_COMPARISONS, "LIKE", "MATCH"):
            raise self._error("expected an operator such as = or BETWEEN", found)
        right = self._operand()
        if not (left.is_field or right.is_field):
            raise self._error("expected the name of a field on one side of the operator", found)
        if left.kind is not right.kind:
            raise self._error(f"cannot compare {left.text} with {right.text}", found)
        if found.kind in _COMPARISONS:
            if not left.is_field:
                left, right = right, left
                compare = _COMPARISONS[_MIRRORED.get(found.kind, found.kind)]
            else:
                compare = _COMPARISONS[found.kind]
            return _compared(left.value, compare, right.value)
        if left.kind is not str:
            raise self._error(f"{found.kind} compares strings only", found)
        return self._matched(found, left, right)

    def _matched(self, found: _Token, left: _Operand, right: _Operand) -> Test:
        pattern = _like if found.kind == "LIKE" else str
        if not right.is_field:
            try:
                compiled = re.compile(pattern(right.value(None)), re.DOTALL)
            except re.error as error:
                raise self._error(f"invalid pattern {right.text}: {error}", found) from None
            return lambda message: compiled.fullmatch(left.value(message)) is not None

        def matches(message: Any) -> bool:
            try:
                wanted = pattern(right.value(message))
                return re.fullmatch(wanted, left.value(message), re.DOTALL) is not None
            except re.error:  # a message cannot end the program by its content
                return False

        return matches

    def _between(self, field: _Operand) -> Test:
        negated = self._accept("NOT")
        word = self._expect("BETWEEN")
        low = self._operand()
        self._expect("AND")
        high = self._operand()
        for end in (low, high):
            if end.is_field:
                raise self._error("expected values as the range of BETWEEN, got a field", word)
            if end.kind is not field.kind:
                raise self._error(f"cannot compare {field.text} with {end.text}", word)
        least, most = low.value(None), high.value(None)
        value = field.value
        return lambda message: (least <= value(message) <= most) is not negated

    def _operand(self) -> _Operand:
        token = self._next()
        if token.kind == "parameter":
            return self._parameter(token)
        if token.kind == "name" and token.text not in _BOOLS:
            return self._field(token)
        literal = _literal(token)
        if literal is None:
            raise self._error("expected a field or a value", token)
        return literal

    def _parameter(self, token: _Token) -> _Operand:
        index = int(token.text[1:])
        if index >= len(self._parameters):
            count = len(self._parameters)
            raise self._error(f"there are {count} parameters, and none for {token.text}", token)
        given = self._parameters[index]
        first, *rest = _tokens(given)
        literal = _literal(first)
        if literal is None or [one.kind for one in rest] not in ([], ["end"]):
            raise self._error(
                f"parameter {token.text} is {given!r}, expected a number, TRUE, FALSE"
                " or a text in single quotes",
                token,
            )
        return literal

    def _field(self, token: _Token) -> _Operand:
        value = self._example
        path = token.text.split(".")
        for name in path:
            fields: Any = getattr(type(value), "get_fields_and_field_types", dict)()
            if name not in fields:
                raise self._error(f"the message has no field {token.text}", token)
            value = getattr(value, name)
        if not isinstance(value, (bool, int, float, str, bytes)):
            raise self._error(f"{token.text} is neither a number nor a string", token)
        read = operator.attrgetter(token.text)
        if isinstance(value, bytes):  # the type `byte`
            return _Operand(lambda message: read(message)[0], float, True, token.text)
        kind = str if isinstance(value, str) else float
        return _Operand(read, kind, True, token.text)

    def _peek(self) -> _Token:
        return self._tokens[self._at]

    def _next(self) -> _Token:
        token = self._tokens[self._at]
        if token.kind != "end":
            self._at += 1
        return token

    def _accept(self, kind: str) -> bool:
        accepted = self._peek().kind == kind
        self._at += accepted
        return accepted

    def _expect(self, kind: str) -> _Token:
        if self._peek().kind != kind:
            raise self._error(f"expected {kind}")
        return self._next()

    def _error(self, problem: str, token: _Token | None = None) -> FilterError:
        start = (token or self._peek()).start
        return FilterError(f"{problem}:\n  '{self._expression}'\n   {' ' * start}^")


def _tokens(expression: str) -> list[_Token]:
    """The tokens of an expression, with one of the kind "end" or "wrong" after the last."""
    tokens, at = [], 0
    while at < len(expression) and (found := _TOKEN.match(expression, at)):
        kind = found.lastgroup or ""
        text, at = found[kind], found.end()
        if kind == "symbol" or (kind == "name" and text.upper() in _WORDS):
            kind = text.upper()
        tokens.append(_Token(kind, text, found.start(found.lastgroup or 0)))
    ended = at == len(expression)
    return [*tokens, _Token("end" if ended else "wrong", expression[at:], at)]


def _literal(token: _Token) -> _Operand | None:
    """The value that a token stands for; None when it stands for none."""
    value: Any
    if token.kind == "number":
        value = _number(token.text)
        if abs(value) >= _MAX_NUMBER and isinstance(value, int):
            return None
    elif token.kind == "text":
        value = token.text[1:-1]
    elif token.text in _BOOLS:
        value = _BOOLS[token.text]
    else:
        return None
    kind = str if isinstance(value, str) else float
    return _Operand(lambda _: value, kind, False, token.text)


def _number(text: str) -> float:
    if "x" in text.lower():
        return int(text, 16)
    return float(text) if set(text) & set(".eE") else int(text)


def _like(pattern: str) -> str:
    return "".join(_WILDCARDS.get(one, re.escape(one)) for one in pattern)


def _both(left: Test, right: Test) -> Test:
    return lambda message: left(message) and right(message)


def _either(left: Test, right: Test) -> Test:
    return lambda message: left(message) or right(message)


def _negated(test: Test) -> Test:
    return lambda message: not test(message)


def _compared(
    left: Callable[[Any], Any], compare: Callable[[Any, Any], bool], right: Callable[[Any], Any]
) -> Test:
    return lambda message: compare(left(message), right(message))
