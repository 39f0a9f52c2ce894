"""The filters that pass on only messages with a changed field."""

import importlib
from types import SimpleNamespace

import pytest


@pytest.fixture
def module(ros_names):
    return importlib.import_module("message_filters.delta_filter")


@pytest.fixture
def source(module):
    return importlib.import_module("message_filters").SimpleFilter()


def point(x, y=0.0, name="a"):
    return SimpleNamespace(at=SimpleNamespace(x=x, y=y), name=name)


def test_a_message_passes_if_one_field_differs_from_the_last_that_passed(module, source):
    found = []
    delta = module.DeltaFilter([lambda one: one.at.x, lambda one: one.name], source)
    delta.registerCallback(lambda one: found.append((one.at.x, one.name)))
    for message in (point(1), point(1, y=5.0), point(2), point(2, name="b"), point(2, name="b")):
        source.signalMessage(message)
    assert found == [(1, "a"), (2, "a"), (2, "b")]


def test_fields_may_be_paths(module, source):
    found = []
    module.PathDeltaFilter(["at.y"], source).registerCallback(found.append)
    for y in (0.0, 0.0, 1.0):
        source.signalMessage(point(1, y))
    assert [one.at.y for one in found] == [0.0, 1.0]


def test_a_path_that_does_not_exist_is_an_error(module, source):
    module.PathDeltaFilter(["at.z"], source)
    source.signalMessage(point(1))
    expected = r"Unable to access field 'z' of SimpleNamespace \(full path: 'at.z'\)"
    with pytest.raises(RuntimeError, match=expected):
        source.signalMessage(point(1))


def test_only_numbers_and_texts_are_compared(module, source):
    module.DeltaFilter([lambda one: one.at], source)
    source.signalMessage(point(1))
    with pytest.raises(TypeError, match="Unable to compare fields of types"):
        source.signalMessage(point(2))


def test_a_filter_has_one_input(module, source):
    delta = module.DeltaFilter([], source)
    with pytest.raises(RuntimeError, match="already has an incoming connection"):
        delta.connectInput(source)


def test_a_handler_of_a_program_needs_a_comparison(module):
    handler = module.CachedComparisonHandler()
    handler._field_getters = [lambda one: one]
    assert handler.message_fits(1)
    with pytest.raises(NotImplementedError, match="do_fields_fit"):
        handler.message_fits(2)
    with pytest.raises(NotImplementedError):
        module.ComparisonHandler().message_fits(1)
