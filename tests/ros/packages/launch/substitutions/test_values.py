"""Substitutions that look up a value."""

import pytest


def test_configuration_has_its_value_or_the_default(launch, perform):
    configuration = launch.substitutions.LaunchConfiguration
    assert perform(configuration("a", default="1"), a="2") == "2"
    assert perform(configuration("a", default=1.5)) == "1.5"
    assert perform(configuration("a", default=configuration("b")), b="3") == "3"
    with pytest.raises(launch.SubstitutionFailure, match="launch configuration 'a' does not exist"):
        perform(configuration("a"))


def test_variable_has_its_value_or_the_default(launch, perform, monkeypatch):
    variable = launch.substitutions.EnvironmentVariable
    monkeypatch.setenv("LAUNCH_T", "x")
    assert perform([variable("LAUNCH_T"), variable("LAUNCH_T_2", default_value="y")]) == "xy"
    with pytest.raises(launch.SubstitutionFailure, match="'LAUNCH_T_2' does not exist"):
        perform(variable("LAUNCH_T_2"))


def test_anonymous_name_is_the_same_for_each_use(launch):
    name, context = launch.substitutions.AnonName("n"), launch.LaunchContext()
    assert name.perform(context).startswith("n_")
    assert name.perform(context) == name.perform(context)
    assert name.perform(context) != name.perform(launch.LaunchContext())
