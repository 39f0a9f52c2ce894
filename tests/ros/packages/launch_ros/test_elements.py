"""Nodes in XML and YAML launch files."""

import importlib
import itertools
from pathlib import Path

import pytest
import yaml

XML = """
<launch>
  <push-ros-namespace namespace="fleet"/>
  <set_parameter name="g" value="1"/>
  <node pkg="demo_nodes_py" exec="talker" name="t" namespace="$(var ns)" args="-x 'a b'">
    <param name="speed" value="2.5"/>
    <param name="nested"><param name="on" value="true"/></param>
    <param name="label" value="7" type="str"/>
    <remap from="chatter" to="/c"/>
  </node>
</launch>
"""
YAML = """
launch:
- push_ros_namespace: {namespace: fleet}
- set_parameter: {name: g, value: 1}
- node:
    pkg: demo_nodes_py
    exec: talker
    name: t
    namespace: $(var ns)
    args: -x 'a b'
    param:
    - {name: speed, value: 2.5}
    - {name: nested, param: [{name: 'on', value: true}]}
    - {name: label, value: '7', type: str}
    remap:
    - {from: chatter, to: /c}
"""


@pytest.mark.parametrize("suffix", ["xml", "yaml"])
def test_node_has_its_arguments(launch, tmp_path, suffix):
    importlib.import_module("launch_ros")
    path = tmp_path / f"a.launch.{suffix}"
    path.write_text(XML if suffix == "xml" else YAML)
    load = launch.launch_description_sources.get_launch_description_from_any_launch_file
    *settings, node = load(str(path)).entities
    context = launch.LaunchContext()
    context.launch_configurations["ns"] = "a"
    for each in settings:
        each.visit(context)
    words = node.prepare_command(context).shown
    assert words[2:7] == ["demo_nodes_py", "talker", "-x", "a b", "--ros-args"]
    assert words[7:13] == ["-r", "__node:=t", "-r", "__ns:=/fleet/a", "-p", "g:=1"]
    assert words[-2:] == ["-r", "chatter:=/c"]
    values = {}
    for option, file in itertools.pairwise(words):
        if option == "--params-file":
            (node_values,) = yaml.safe_load(Path(file).read_text()).items()
            assert node_values[0] == "/fleet/a/t"
            values.update(node_values[1]["ros__parameters"])
    assert values == {"speed": 2.5, "nested.on": True, "label": "7"}
