"""The elements of XML and YAML launch files, apart from those of ROS."""

import sys

import pytest

XML = """
<launch>
  <arg name="robot" default="r2" description="which">
    <choice value="r2"/>
    <choice value="d2"/>
  </arg>
  <let name="both" value="$(var robot)-$(env LAUNCH_T none)"/>
  <group>
    <set_env name="LAUNCH_T" value="inside"/>
    <log message="$(env LAUNCH_T) $(dirname)"/>
  </group>
  <log message="$(var both)" level="WARNING"/>
  <log message="no" if="false"/>
  <log message="$(eval '1 + 1')" unless="$(not true)"/>
  <timer period="0.5"><log message="later"/></timer>
</launch>
"""

YAML = """
launch:
- arg:
    name: robot
    default: r2
    description: which
    choice: [{value: r2}, {value: d2}]
- let: {name: both, value: $(var robot)-$(env LAUNCH_T none)}
- group:
  - set_env: {name: LAUNCH_T, value: inside}
  - log: {message: $(env LAUNCH_T) $(dirname)}
- log: {message: $(var both), level: WARNING}
- log: {message: 'no', if: false}
- log: {message: $(eval '1 + 1'), unless: $(not true)}
- timer:
    period: 0.5
    children:
    - log: {message: later}
"""


@pytest.fixture
def play_text(launch, play, tmp_path):
    async def play_text(text, suffix="xml", **arguments):
        path = tmp_path / f"a.launch.{suffix}"
        path.write_text(text)
        pairs = arguments.items()
        include = launch.actions.IncludeLaunchDescription(str(path), launch_arguments=pairs)
        return await play(include)

    return play_text


@pytest.mark.parametrize(("text", "suffix"), [(XML, "xml"), (YAML, "yaml")], ids=["xml", "yaml"])
async def test_file_does_the_same_in_both_formats(play_text, tmp_path, text, suffix):
    code, lines = await play_text(text, suffix)
    assert (code, lines) == (
        0,
        [
            f"[INFO] [launch.user]: inside {tmp_path}",
            "[WARNING] [launch.user]: r2-none",
            "[INFO] [launch.user]: 2",
            "[INFO] [launch.user]: later",
        ],
    )
    code, lines = await play_text(text, suffix, robot="x")
    assert "provided value 'x' is not valid" in lines[0]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("<launch>\n<nope/></launch>", ", line 2: Unrecognized entity of the type: nope"),
        ("<launch>\n<arg/></launch>", ", line 2: Attribute 'name' not found in Entity 'arg'"),
        ("<launch>\n\n<log message='a' msg='b'/></launch>", ", line 3: Unexpected attribute"),
        ("<launch>\n<log message='$(nope)'/></launch>", "Unknown substitution: nope"),
        ("<launch>\n<log message='$(var)'/></launch>", "substitution 'var': "),
        ("<launch>\n<log", ", line 2: invalid XML: unclosed token"),
        ("<robot/>", "Expected 'launch' as root tag, got 'robot'"),
    ],
)
async def test_mistake_is_one_line_with_its_place(play_text, text, problem):
    code, (line,) = await play_text(text)
    assert code == 1
    assert problem in line


@pytest.mark.real_time
@pytest.mark.skipif(sys.platform == "win32", reason="a line for sh")
async def test_executable_starts_with_variables(play_text):
    text = (
        '<launch><executable cmd="sh -c \'echo $X $1\' - $(var a)" output="screen" name="e">'
        '<env name="X" value="5"/></executable></launch>'
    )
    _, lines = await play_text(text, a="two words")
    assert "[e-1] 5 two words" in lines


async def test_file_includes_another_one_with_arguments(play_text, tmp_path):
    (tmp_path / "inner.launch.yaml").write_text(
        "launch:\n- arg: {name: a}\n- log: {message: got $(var a)}\n"
    )
    text = (
        '<launch><include file="$(dirname)/inner.launch.yaml"><arg name="a" value="$(var b)"/>'
        "</include></launch>"
    )
    assert await play_text(text, b="1") == (0, ["[INFO] [launch.user]: got 1"])


@pytest.mark.parametrize(
    ("element", "problem"),
    [
        ("<param/>", "Unrecognized entity of the type: param; in ROS 2, write it inside the node;"),
        ("<grup/>", "Unrecognized entity of the type: grup; did you mean group?"),
        ('<log message="$(arg a)"/>', "Unknown substitution: arg; in ROS 2, write $(var NAME)"),
        ('<log message="$(varr a)"/>', "Unknown substitution: varr; did you mean var?"),
        ('<log mesage="a"/>', "'message' not found in Entity 'log'; did you mean message?"),
        ('<node pkg="a" type="b"/>', "; `type`: in ROS 2, its name is exec"),
        ('<include file="a" ns="b"/>', "; `ns`: in ROS 2, write a group with push_ros_namespace"),
    ],
)
async def test_name_of_ros_1_or_a_misspelt_one_gets_a_hint(play_text, element, problem):
    code, (line,) = await play_text(f"<launch>{element}</launch>")
    assert code == 1
    assert problem in line


async def test_yaml_with_too_little_indentation_gets_a_hint(play_text):
    code, (line,) = await play_text("launch:\n- node:\n  pkg: a\n  exec: b\n", "yaml")
    assert code == 1
    assert "indent the lines below `- node:` by two more spaces" in line
