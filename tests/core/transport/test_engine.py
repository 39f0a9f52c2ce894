"""Every engine has all methods of the interface, with the same parameters."""

import inspect

import pytest

from taskrpc.core.transport.engine import NativeEngine
from taskrpc.testing.memory_engine import MemoryEngine

ENGINES = [MemoryEngine]


def methods(of):
    return {
        name: each
        for name, each in inspect.getmembers(of, inspect.isfunction)
        if not name.startswith("_")
    }


@pytest.mark.parametrize("engine", ENGINES)
def test_an_engine_has_every_method_of_the_interface(engine):
    wanted, there = methods(NativeEngine), methods(engine)
    assert wanted.keys() <= there.keys()
    for name, method in wanted.items():
        parameters = list(inspect.signature(method).parameters)
        assert list(inspect.signature(there[name]).parameters) == parameters, name
        is_async = inspect.iscoroutinefunction(method)
        assert inspect.iscoroutinefunction(there[name]) == is_async, name


def test_every_method_of_the_interface_says_what_it_does():
    assert [name for name, each in methods(NativeEngine).items() if not each.__doc__] == []
