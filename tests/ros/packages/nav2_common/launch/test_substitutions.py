"""Substitutions of `nav2_common.launch` return the paths of changed parameter files."""

import importlib
import sys
from pathlib import Path

import pytest

TEXT = "amcl:\n  ros__parameters:\n    frame: <ns>/base\n    use_sim_time: false\n"


@pytest.fixture
def nav2(launch):
    return importlib.import_module("nav2_common.launch")


@pytest.fixture
def source(tmp_path):
    path = tmp_path / "nav2.yaml"
    path.write_text(TEXT)
    return path


def test_rewritten_yaml_is_a_file_with_other_values_below_a_root_key(nav2, launch, perform, source):
    configuration = launch.substitutions.LaunchConfiguration
    found = nav2.RewrittenYaml(
        source_file=source,
        param_rewrites={"use_sim_time": configuration("sim")},
        root_key=configuration("ns"),
        convert_types=True,
    )
    text = Path(perform(found, sim="true", ns="r2")).read_text()
    parameters = "      frame: <ns>/base\n      use_sim_time: true\n"
    assert text == f"r2:\n  amcl:\n    ros__parameters:\n{parameters}"
    assert Path(perform(found, sim="true", ns="")).read_text().startswith("amcl:")
    assert source.read_text() == TEXT


async def test_rewritten_yaml_is_a_parameter_file_of_a_node(nav2, launch, play, source):
    descriptions = importlib.import_module("launch_ros.descriptions")
    rewritten = nav2.RewrittenYaml(source, {"use_sim_time": "True"})

    def show(context):
        path = descriptions.ParameterFile(rewritten, allow_substs=True).evaluate(context)
        return [launch.actions.LogInfo(msg=str("use_sim_time: true" in path.read_text()))]

    code, lines = await play(launch.actions.OpaqueFunction(function=show))
    assert (code, lines) == (0, ["[INFO] [launch.user]: True"])


def test_replace_string_copies_the_file_under_its_condition(nav2, launch, perform, source):
    texts = {"<ns>": ("/", launch.substitutions.LaunchConfiguration("ns"))}
    replaced = nav2.ReplaceString(source_file=source, replacements=texts)
    assert "frame: /r2/base" in Path(perform(replaced, ns="r2")).read_text()
    never = launch.conditions.IfCondition("false")
    assert perform(nav2.ReplaceString(source, texts, never)) == str(source)


def test_missing_file_is_named(nav2, launch, perform, tmp_path):
    with pytest.raises(launch.SubstitutionFailure, match=r"nope\.yaml: No such file or directory"):
        perform(nav2.RewrittenYaml(tmp_path / "nope.yaml", {}))


def test_facts_are_true_or_false(nav2, perform, source):
    assert perform(nav2.HasNodeParams(source, "amcl")) == "True"
    assert perform(nav2.HasNodeParams(source, "planner")) == "False"
    for text, value in {"yes": "True", "1": "True", "TRUE": "True", "0": "False"}.items():
        assert perform(nav2.LaunchConfigAsBool("a"), a=text) == value


def test_poses_of_robots_are_read_from_the_command_line(nav2, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["launch", "robots:=a={x: 1, yaw: 0.5}; b={};"])
    zero = dict.fromkeys(("x", "y", "z", "roll", "pitch", "yaw"), 0.0)
    found = nav2.ParseMultiRobotPose("robots").value()
    assert found == {"a": {**zero, "x": 1.0, "yaw": 0.5}, "b": zero}
    assert nav2.ParseMultiRobotPose("other").value() == {}
