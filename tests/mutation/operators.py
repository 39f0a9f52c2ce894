"""What a mutant is here: mutmut's operators, less those that change text, plus removed statements.

Text is left alone because the tests pin the sentences that users depend on, and each of the other
sentences would give three mutants that say nothing about behaviour. Removed statements are added
because mutmut has no such operator, and most bugs that reviewers planted were of this kind.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import libcst as cst
import libcst.matchers as m
from mutmut.mutation import mutators

_TEXT = m.SimpleString() | m.FormattedString() | m.ConcatenatedString()
_LOG = m.Call(func=m.Attribute(value=m.Name("log") | m.Name("_log")))
_LOGGED = m.Expr(value=_LOG)
_STORED = m.Attribute() | m.Subscript()


def install() -> None:
    """Replace mutmut's operators in this process and in those that it forks."""
    given = list(mutators.mutation_operators)
    mutators.mutation_operators[:] = [
        (kind, _without_text(operator))
        for kind, operator in given
        if operator is not mutators.operator_string
    ]
    mutators.mutation_operators.append((cst.SimpleStatementLine, remove_statement))
    mutators.mutation_operators.append((cst.If, negate_condition))


def remove_statement(node: cst.SimpleStatementLine) -> Iterator[cst.SimpleStatementLine]:
    """Leave out a call, a `del`, or an assignment to an attribute or an item."""
    if len(node.body) != 1:
        return
    statement = node.body[0]
    stored = m.Assign(targets=[m.AssignTarget(target=_STORED)]) | m.AugAssign(target=_STORED)
    called = m.Expr(value=m.Call() | m.Await())
    if m.matches(statement, called | stored | m.Del()) and not m.matches(statement, _LOGGED):
        yield node.with_changes(body=[cst.Pass()])


def negate_condition(node: cst.If) -> Iterator[cst.If]:
    """Negate a condition that no other operator changes: a name, an attribute or a call."""
    if m.matches(node.test, m.Name() | m.Attribute() | m.Call()):
        yield node.with_changes(test=cst.UnaryOperation(operator=cst.Not(), expression=node.test))


def _without_text(operator: Callable[[Any], Iterable[cst.CSTNode]]) -> Any:
    """The operator, without the mutants that only change or remove text or log lines."""

    def mutated(node: cst.CSTNode) -> Iterator[cst.CSTNode]:
        if m.matches(node, _LOG):
            return
        for mutant in operator(node):
            if not _changes_text(node, mutant):
                yield mutant

    return mutated


def _changes_text(node: cst.CSTNode, mutant: cst.CSTNode) -> bool:
    if isinstance(node, cst.Call) and isinstance(mutant, cst.Call):
        kept = {id(arg) for arg in mutant.args}
        gone = [arg.value for arg in node.args if id(arg) not in kept]
        return bool(gone) and all(m.matches(value, _TEXT) for value in gone)
    if isinstance(node, cst.Assign | cst.AnnAssign) and node.value is not None:
        # An attribute that becomes None is found as easily as one that is not assigned.
        return m.matches(node.value, _TEXT) or (
            isinstance(node, cst.Assign) and m.matches(node.targets[0].target, _STORED)
        )
    return False
