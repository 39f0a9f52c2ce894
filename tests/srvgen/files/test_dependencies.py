"""Dependencies of a definition: their order, and the errors of types that cannot be used."""

import tracemalloc
from pathlib import Path

import pytest

import srvgen
from srvgen.definitions import limits
from srvgen.definitions.lines import join_full_text
from srvgen.errors import DefinitionError, DefinitionErrors
from srvgen.files.search import Search
from tests.srvgen.hostile import EVENT, bundled, define, refused
from tests.srvgen.sample_definitions import put

pytestmark = pytest.mark.usefixtures("workspace")


def test_dependencies_come_before_their_dependents():
    names = [one.full_name for one in Search().with_dependencies("geometry_msgs/msg/PoseStamped")]
    for earlier, later in [("Point", "Pose"), ("Quaternion", "Pose"), ("Pose", "PoseStamped")]:
        assert names.index(f"geometry_msgs/msg/{earlier}") < names.index(
            f"geometry_msgs/msg/{later}"
        )
    assert len(names) == len(set(names))


def test_a_service_needs_the_information_of_its_events():
    names = [one.full_name for one in Search().with_dependencies("std_srvs/srv/Empty")]
    assert names == [
        "builtin_interfaces/msg/Time",
        "service_msgs/msg/ServiceEventInfo",
        "std_srvs/srv/Empty",
    ]


def test_every_missing_type_is_reported_at_the_field_that_refers_to_it(workspace):
    path = put(
        "my_msgs/srv/Fetch", "Header header\nstd_msg/String s\n---\nString text\n", workspace
    )
    with pytest.raises(DefinitionErrors) as caught:
        Search().with_dependencies("my_msgs/srv/Fetch")
    problems = caught.value.problems
    assert [(one.path, one.line, one.column) for one in problems] == [
        (str(path), 1, 1),
        (str(path), 2, 1),
        (str(path), 4, 1),
    ]
    assert problems[0].hint == "ROS 2 writes std_msgs/Header"
    assert problems[1].source_line == "std_msg/String s"
    assert problems[2].hint == "did you mean string or std_msgs/String?"


def test_type_that_contains_itself_is_refused_with_the_cycle(workspace):
    put("my_msgs/msg/Egg", "Hen hen", workspace)
    put("my_msgs/msg/Hen", "Egg[] eggs", workspace)
    with pytest.raises(DefinitionError) as caught:
        Search().with_dependencies("my_msgs/msg/Egg")
    assert "my_msgs/msg/Egg → my_msgs/msg/Hen → my_msgs/msg/Egg" in caught.value.message
    assert Path(caught.value.path).name == "Hen.msg"
    put("my_msgs/msg/Self", "Self[] more", workspace)
    with pytest.raises(DefinitionError, match="my_msgs/msg/Self → my_msgs/msg/Self"):
        Search().with_dependencies("my_msgs/msg/Self")


def test_time_types_of_ros_1_are_refused_with_those_of_ros_2(workspace):
    put("my_msgs/msg/Old", "time stamp", workspace)
    for find in (Search().load, Search().with_dependencies):
        with pytest.raises(DefinitionError) as caught:
            find("my_msgs/msg/Old")
        assert (caught.value.line, caught.value.hint) == (
            1,
            "ROS 2 writes builtin_interfaces/Time",
        )


def test_a_broken_dependency_is_reported_once_in_its_own_file(workspace):
    put("my_msgs/msg/Good", "Bad a\nBad b\n", workspace)
    bad = put("my_msgs/msg/Bad", "int x", workspace)
    with pytest.raises(DefinitionError) as caught:
        Search().with_dependencies("my_msgs/msg/Good")
    assert not isinstance(caught.value, DefinitionErrors)
    assert caught.value.path == str(bad)


@pytest.mark.parametrize(
    "field",
    [
        "uint8[4000000000] x",
        "uint8[1000000000] x",
        "string[4000000000] x",
        "float64[999999999999999999999999] x",
        "geometry_msgs/Pose[1000000000] x",
    ],
)
def test_a_huge_fixed_array_is_refused_and_never_made(field):
    texts = {one: bundled.text(one) for one in EVENT}
    for name in ("Pose", "Point", "Quaternion"):
        texts[f"geometry_msgs/msg/{name}"] = bundled.text(f"geometry_msgs/msg/{name}")
    tracemalloc.start()
    try:
        with pytest.raises(DefinitionError, match="expected at most 67,108,864 bytes") as caught:
            srvgen.define("far_msgs/srv/Ask", join_full_text(f"{field}\n---\n", texts))
        assert tracemalloc.get_traced_memory()[1] < 2**23
    finally:
        tracemalloc.stop()
    assert (caught.value.line, caught.value.source_line) == (1, field)


def test_arrays_inside_arrays_count_by_their_product():
    needed = {f"Level{n}": f"Level{n + 1}[100] x\n" for n in range(1, 6)}
    message = refused("Level1[100] x\n---\n", **needed, Level6="int32 a\n")
    assert message.startswith("expected at most 67,108,864 bytes")


def test_large_bounds_allocate_no_memory():
    ask = define("uint8[<=4000000000] x\nstring<=4000000000 y\n---\n")
    assert len(ask.Request().x) == 0


def test_a_large_array_within_the_bound_is_fine():
    assert len(define("uint8[1000000] x\n---\n").Request().x) == 1_000_000


def test_deeply_nested_types_give_an_error_instead_of_a_recursion_error():
    chain = {f"Link{n}": f"Link{n + 1} x\n" for n in range(400)}
    message = refused("Link0 x\n---\n", **chain, Link400="int32 a\n")
    assert message == "expected at most 64 levels of nested types, got more"


def test_the_deepest_nesting_that_is_allowed_works():
    depth = limits.DEPTH - 2
    chain = {f"Link{n}": f"Link{n + 1} x\n" for n in range(depth)}
    ask = define("Link0 x\n---\n", **chain, **{f"Link{depth}": "int32 a 5\n"})
    inner = ask.Request()
    inner._check()
    while hasattr(inner, "x"):
        inner = inner.x
    assert inner.a == 5


def test_types_of_a_wide_tree_are_built_once():
    """Sixteen layers, each with four of the next: a message with four thousand million parts."""
    layers = {f"Layer{n}": "".join(f"Layer{n + 1} {c}\n" for c in "abcd") for n in range(16)}
    message = refused("Layer0 x\n---\n", **layers, Layer16="int32 a\n")
    assert message.startswith("expected at most 67,108,864 bytes")
