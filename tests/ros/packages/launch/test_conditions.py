"""Conditions decide whether an action is executed."""

import pytest


@pytest.mark.parametrize(("text", "expected"), [("true", 1), (" TRUE", 1), ("1", 1), ("0", 0)])
def test_text_is_true_or_false(launch, text, expected):
    conditions, context = launch.conditions, launch.LaunchContext()
    assert conditions.IfCondition(text).evaluate(context) == expected
    assert conditions.UnlessCondition(text).evaluate(context) != expected


def test_other_texts_are_an_error(launch):
    with pytest.raises(
        launch.conditions.InvalidConditionExpressionError,
        match=r"expected condition expression to be one of .* but got 'yes'",
    ):
        launch.conditions.IfCondition("yes").evaluate(launch.LaunchContext())


def test_configuration_has_a_value_or_is_missing(launch):
    context = launch.LaunchContext()
    context.launch_configurations["robot"] = "a"
    equals = launch.conditions.LaunchConfigurationEquals
    assert equals("robot", "a").evaluate(context)
    assert not equals("robot", "b").evaluate(context)
    assert equals("other", None).evaluate(context)
    assert launch.conditions.LaunchConfigurationNotEquals("robot", "b").evaluate(context)
