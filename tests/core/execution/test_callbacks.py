"""A callback that cannot be called with the expected arguments is refused, with its place."""

import inspect
from functools import partial, wraps

import pytest

from taskrpc.core.execution.callbacks import problem_of_callback


class Greeter:
    def greet(self, request, response):
        return response

    def forgetful(self, request):
        return request

    @staticmethod
    def alone(request):
        return request

    def __call__(self, request):
        return request


async def later(request):
    return request


def with_default(request, response, times=1):
    return response


def with_keyword(request, response, *, times):
    return response


def anything(*args):
    return args[1]


def adds_an_argument(function):
    @wraps(function)
    def wrapper(*args):
        return function(*args, 3)

    return wrapper


TAKING = [
    adds_an_argument(lambda request, response, times: response),
    Greeter().greet,
    with_default,
    anything,
    partial(with_default, times=2),
    partial(with_keyword, times=2),
    lambda request, response: response,
    max,
]
NOT_TAKING = [
    (Greeter.greet, "Greeter.greet(self, request, response)"),
    (Greeter().forgetful, "Greeter.forgetful(request)"),
    (Greeter.alone, "Greeter.alone(request)"),
    (Greeter(), "(request)"),
    (Greeter, "Greeter()"),
    (later, "later(request)"),
    (with_keyword, "with_keyword(request, response, *, times)"),
    (partial(with_default, 1, 2), "(times=1)"),
    (lambda request: request, "<lambda>(request)"),
]


@pytest.mark.parametrize("callback", TAKING)
def test_callback_that_can_be_called_has_no_problem(callback):
    assert problem_of_callback(callback, "the callback of /a", ("a request", "a response")) == ""


@pytest.mark.parametrize(("callback", "shown"), NOT_TAKING)
def test_callback_with_other_parameters_is_named_with_its_place(callback, shown):
    problem = problem_of_callback(callback, "the callback of /a", ("a request", "a response"))
    assert problem.startswith(
        "the callback of /a: expected a function that takes a request, a response, got "
    )
    assert shown in problem
    # A class without `__init__` has no place.
    assert (f" at {__file__}:" in problem) is (callback is not Greeter)
    assert "\n" not in problem


def test_a_callback_with_a_signature_that_a_decorator_publishes_is_accepted():
    def inject(function):
        def with_database(*arguments):
            return function("database", *arguments)

        with_database.__signature__ = inspect.signature(function)
        return with_database

    @inject
    def handler(database, request, response):
        return response

    assert problem_of_callback(handler, "the callback of /s", ("a request", "a response")) == ""
