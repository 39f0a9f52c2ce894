"""A program's syntax tree gives its callbacks, and the calls that happen inside them."""

import ast

import pytest

from taskrpc.ros.graduation.program import Program, called, dotted
from tests.ros.graduation.sample_programs import HELPED, TIMER, method, program


def parsed(text: str) -> Program:
    return Program(ast.parse(text))


def calls_inside(found: Program) -> set[tuple[str, tuple[str, ...]]]:
    return {(called(step.call), step.through) for step in found.inside}


def test_calls_of_functions_that_a_callback_uses_happen_inside_it():
    found = parsed(program(TIMER, HELPED))
    assert [(one.kind, one.name) for one in found.callbacks] == [("create_timer", "tick")]
    assert {("ask", ("tick",)), ("call", ("tick", "ask"))} <= calls_inside(found)


def test_functions_that_call_each_other_are_followed_once():
    methods = method("def tick(self):", "self.tock()") + method("def tock(self):", "self.tick()")
    assert calls_inside(parsed(program(TIMER, methods))) == {
        ("tock", ("tick",)),
        ("tick", ("tick", "tock")),
    }


@pytest.mark.parametrize(
    "callback", ["self.tick", "partial(self.tick, 1)", "functools.partial(self.tick)"]
)
def test_callback_is_found_in_each_spelling(callback):
    setup = f"self.create_timer(1.0, {callback})"
    found = parsed(program(setup, method("def tick(self):", "print(1)")))
    assert calls_inside(found) == {("print", ("tick",))}


def test_callback_given_by_name_or_as_a_lambda_is_found():
    for callback in ("lambda: print(1)", "shout"):
        setup = f"self.create_timer(timer_period_sec=1.0, callback={callback})"
        found = parsed("def shout():\n    print(1)\n" + program(setup))
        assert [called(step.call) for step in found.inside] == ["print"]


def test_calls_inside_an_inner_function_do_not_happen_when_the_callback_runs():
    methods = method("def tick(self):", "def later():", "    print(1)", "len('')")
    assert calls_inside(parsed(program(TIMER, methods))) == {("len", ("tick",))}


def test_clients_are_known_by_the_variables_that_hold_them():
    found = parsed(program("other: object = self.create_client(AddTwoInts, 'other')"))
    assert found.clients.keys() == {"self.client", "other"}


def test_program_for_ros_is_recognised_by_its_imports():
    assert parsed("from rclpy.node import Node").imports_rclpy
    assert not parsed("import rclpyx").imports_rclpy


@pytest.mark.parametrize(("text", "name"), [("a.b.c", "a.b.c"), ("a().b", ""), ("a", "a")])
def test_dotted_name_of_an_expression(text, name):
    assert dotted(ast.parse(text, mode="eval").body) == name
