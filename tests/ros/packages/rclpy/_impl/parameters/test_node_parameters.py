"""A node declares, sets, checks and lists parameters, and tells of changes, as rclpy's does."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

import srvgen
from taskrpc.ros.packages.rclpy import exceptions
from taskrpc.ros.packages.rclpy._impl.arguments import parse
from taskrpc.ros.packages.rclpy._impl.parameters.node_parameters import NodeParameters
from taskrpc.ros.packages.rclpy.clock import Clock
from taskrpc.ros.packages.rclpy.parameter import Parameter, ParameterValue

Descriptor = srvgen.load("rcl_interfaces/msg/ParameterDescriptor")
Result = srvgen.load("rcl_interfaces/msg/SetParametersResult")
IntegerRange = srvgen.load("rcl_interfaces/msg/IntegerRange")
FloatingPointRange = srvgen.load("rcl_interfaces/msg/FloatingPointRange")
Type = Parameter.Type


class Publisher:
    def __init__(self):
        self.published = []

    def publish(self, message):
        self.published.append(message)


class FakeNode:
    """As much of a node as parameters need."""

    def __init__(self, *line, overrides=None, allow=False):
        self.publisher = Publisher()
        line = parse(["--ros-args", *line])
        self.parameters = NodeParameters(self, [line], overrides, allow)

    def __getattr__(self, name):
        return getattr(self.parameters, name)

    def get_fully_qualified_name(self):
        return "/ns/robot"

    def create_publisher(self, msg_type, topic, qos_profile):
        assert (msg_type.__name__, topic, qos_profile.depth) == (
            "ParameterEvent",
            "/parameter_events",
            1000,
        )
        return self.publisher

    def get_clock(self):
        return Clock()

    def value(self, name):
        return self.get_parameter(name).value

    def try_set(self, **values):
        return self.set_parameters_atomically([Parameter(n, value=v) for n, v in values.items()])


@pytest.fixture
def node():
    return FakeNode()


@pytest.fixture
def lenient():
    return FakeNode(allow=True)


def test_a_declared_parameter_has_its_default(node):
    assert node.declare_parameter("speed", 1.5).value == 1.5
    assert node.get_parameter("speed").type_ == Type.DOUBLE
    assert node.has_parameter("speed")
    assert not node.has_parameter("other")


def test_overrides_come_before_defaults_the_constructor_s_first():
    node = FakeNode("-p", "a:=1", "-p", "b:=1", overrides=[Parameter("b", value=2)])
    declared = node.declare_parameters("", [("a", 0), ("b", 0), ("c", 0)])
    assert [one.value for one in declared] == [1, 2, 0]
    assert node.declare_parameters("group", [("a", 7)])[0].name == "group.a"


def test_overrides_can_be_ignored_or_declared_all_at_once():
    node = FakeNode("-p", "a:=1", "-p", "b.c:=[x]")
    assert node.declare_parameter("a", 0, ignore_override=True).value == 0
    node.undeclare_parameter("a")
    node.declare_overrides()
    assert (node.value("a"), node.value("b.c")) == (1, ["x"])


def test_an_override_of_another_type_is_refused():
    node = FakeNode("-p", "a:=fast")
    with pytest.raises(exceptions.InvalidParameterTypeException) as caught:
        node.declare_parameter("a", 1)
    assert str(caught.value) == (
        "Trying to set parameter 'a' to 'fast' of type 'STRING', expecting type 'INTEGER': a"
    )
    assert not node.has_parameter("a")


def test_a_parameter_can_be_declared_by_its_type(node):
    assert node.declare_parameter("a", Type.INTEGER).type_ == Type.NOT_SET
    with pytest.raises(exceptions.ParameterUninitializedException, match="'a' is not initialized"):
        node.get_parameter("a")
    assert node.get_parameter_or("a", Parameter("b", value=5)).value == 5
    assert node.try_set(a="x").reason.startswith("Wrong parameter type, expected 'Type.INTEGER'")
    assert node.try_set(a=3).successful
    assert node.try_set(a=None).reason == "Static parameter cannot be undeclared"


def test_a_name_alone_is_declared_with_a_warning(node):
    named = "'a', declaring a parameter only providing its name"
    with pytest.warns(UserWarning, match=named) as told:
        assert node.declare_parameter("a").value is None
    assert told[0].filename == __file__, "the program's line is shown"
    assert node.try_set(a=1).successful
    assert node.try_set(a="x").successful


def test_a_default_may_be_a_parameter_value(node):
    value = ParameterValue(type=2, integer_value=7)
    assert node.declare_parameter("a", value).value == 7


@pytest.mark.parametrize(
    ("entry", "error", "problem"),
    [
        ((), TypeError, "Invalid parameter tuple length at index 0"),
        ((1, 2), TypeError, "First element 1 at index 0 in parameters list is not a str"),
        (("",), exceptions.InvalidParameterException, "Invalid parameter name: $"),
        (("a", 1, 5), TypeError, "Third element 5 at index 0 .* is not a ParameterDescriptor"),
        (("a", Type.NOT_SET), ValueError, "statically typed of type NOT_SET"),
        (("a", Type.BOOL, Descriptor(dynamic_typing=True)), ValueError, "is not allowed when"),
        (("a", None, Descriptor()), ValueError, "of type PARAMETER_NOT_SET"),
        (("a", ParameterValue()), ValueError, "of type PARAMETER_NOT_SET"),
        (("a", {}), TypeError, "not one of the allowed types"),
    ],
)
def test_an_impossible_declaration_is_reported(node, entry, error, problem):
    with pytest.raises(error, match=problem):
        node.declare_parameters("", [entry])
    assert node.list_parameters([], 0).names == []


def test_nothing_is_declared_twice(node):
    node.declare_parameter("a", 1)
    with pytest.raises(exceptions.ParameterAlreadyDeclaredException, match=r"\['a'\]"):
        node.declare_parameters("", [("b", 1), ("a", 2)])
    assert not node.has_parameter("b")


@pytest.mark.parametrize("ask", ["get_parameter", "get_parameter_type", "describe_parameter"])
def test_an_undeclared_parameter_is_an_error_unless_allowed(node, lenient, ask):
    with pytest.raises(exceptions.ParameterNotDeclaredException, match=r"undeclared .*: a$"):
        getattr(node, ask)("a")
    getattr(lenient, ask)("a")


def test_setting_an_undeclared_parameter_sets_none(node):
    node.declare_parameter("a", 1)
    with pytest.raises(exceptions.ParameterNotDeclaredException, match=r"\['b'\]"):
        node.try_set(a=2, b=1)
    assert node.value("a") == 1
    assert [one.successful for one in node.set_parameters([Parameter("a", value=2)])] == [True]
    with pytest.raises(TypeError, match="must be instance of type"):
        node.set_parameters([42])


def test_undeclared_parameters_that_are_allowed_may_change_their_type(lenient):
    assert lenient.get_parameter("a").type_ == Type.NOT_SET
    assert lenient.get_parameter_type("a") == Type.NOT_SET
    assert lenient.describe_parameter("a") == Descriptor()
    assert lenient.try_set(a=1).successful
    assert lenient.try_set(a="x").successful
    assert lenient.value("a") == "x"
    assert lenient.get_parameter_types(["a"]) == [4]
    assert lenient.try_set(a=None).successful
    assert not lenient.has_parameter("a")


def test_a_read_only_parameter_never_changes(node):
    node.declare_parameter("a", 1, Descriptor(read_only=True))
    assert node.try_set(a=2).reason == "Trying to set a read-only parameter: a."
    with pytest.raises(exceptions.ParameterImmutableException):
        node.undeclare_parameter("a")
    with pytest.raises(exceptions.ParameterImmutableException):
        node.set_descriptor("a", Descriptor())
    assert node.value("a") == 1


INTEGERS = [
    (0, ""),
    (10, ""),
    (4, ""),
    (12, "Parameter a out of range. Min: 0, Max: 10, value: 12"),
    (-1, "Parameter a out of range. Min: 0, Max: 10, value: -1"),
    (
        5,
        "The parameter value for a is not a valid step. Min: 0, max: 10, value: 5, step: 2",
    ),
]
FLOATS = [
    (0.0, ""),
    (10.0, ""),
    (4.5, ""),
    (0.1 * 5, ""),
    (12.0, "Parameter a out of range Min: 0.0, Max: 10.0, value: 12.0"),
    (
        4.25,
        "The parameter value for a is not close enough to a valid step. "
        "Min: 0.0, max: 10.0, value: 4.25, step: 0.5",
    ),
]


@pytest.mark.parametrize(("value", "reason"), INTEGERS + FLOATS)
def test_a_range_has_ends_and_steps(node, value, reason):
    limits = Descriptor(
        integer_range=[IntegerRange(from_value=0, to_value=10, step=2)],
        floating_point_range=[FloatingPointRange(from_value=0.0, to_value=10.0, step=0.5)],
    )
    node.declare_parameter("a", type(value)(0), limits)
    assert node.try_set(a=value).reason == reason
    node.undeclare_parameter("a")
    if reason:
        with pytest.raises(exceptions.InvalidParameterValueException) as caught:
            node.declare_parameter("a", value, limits)
        assert str(caught.value) == (
            f"Invalid parameter value ({value}) for parameter. Reason: {reason}: a"
        )


def test_a_range_without_steps_allows_all_between(node):
    for value in (7, 3.3, "text"):
        limits = Descriptor(
            integer_range=[IntegerRange(from_value=0, to_value=10)],
            floating_point_range=[FloatingPointRange(from_value=0.0, to_value=10.0)],
        )
        assert node.declare_parameter(f"p{type(value)}", value, limits).value == value


def test_callbacks_change_accept_and_observe_parameters(node):
    told = []

    def double(parameters):
        return [Parameter(one.name, value=one.value * 2) for one in parameters]

    def allow_even(parameters):
        odd = any(one.value % 2 for one in parameters)
        return Result(successful=not odd, reason="odd" if odd else "")

    node.declare_parameter("a", 0)
    node.add_on_set_parameters_callback(allow_even)
    assert allow_even in node.on_set_callbacks
    node.add_post_set_parameters_callback(lambda all_set: told.extend(p.value for p in all_set))
    assert node.try_set(a=3).reason == "odd"
    node.add_pre_set_parameters_callback(double)
    assert node.try_set(a=3).successful
    assert (node.value("a"), told) == (6, [6])
    node.remove_pre_set_parameters_callback(double)
    node.remove_on_set_parameters_callback(allow_even)
    assert node.try_set(a=3).successful
    with pytest.raises(ValueError, match="not in list"):
        node.remove_post_set_parameters_callback(allow_even)


def test_callbacks_are_asked_from_the_last_to_the_first_until_one_refuses(node):
    asked = []
    node.declare_parameter("a", 0)
    for name, allows in [("first", True), ("second", False), ("third", True)]:
        node.add_on_set_parameters_callback(
            lambda _, name=name, allows=allows: asked.append(name) or Result(successful=allows)
        )
    assert not node.try_set(a=1).successful
    assert asked == ["third", "second"]
    with pytest.raises(exceptions.InvalidParameterValueException):
        node.declare_parameter("b", 1)


def test_a_callback_without_a_result_rejects_with_a_warning(node):
    def forgetful(parameters):
        pass

    node.declare_parameter("a", 0)
    node.add_on_set_parameters_callback(forgetful)
    with pytest.warns(UserWarning, match=r"callback forgetful .* returned None, expected a Set"):
        result = node.try_set(a=1)
    assert (result.successful, result.reason) == (False, "Callback returned an invalid type")
    assert node.value("a") == 0


def test_a_callback_that_empties_the_list_is_reported(node):
    node.declare_parameter("a", 0)
    node.add_pre_set_parameters_callback(lambda parameters: [])
    assert node.try_set(a=1).reason.startswith("parameter list cannot be empty, this might be")


def test_every_change_is_published(lenient):
    lenient.try_set(a=1)
    lenient.try_set(a=2, b=3)
    lenient.try_set(a=None)
    assert [
        tuple(
            [(one.name, one.value.integer_value) for one in kind]
            for kind in (event.new_parameters, event.changed_parameters, event.deleted_parameters)
        )
        for event in lenient.publisher.published
    ] == [
        ([("a", 1)], [], []),
        ([("b", 3)], [("a", 2)], []),
        ([], [], [("a", 0)]),
    ]
    assert {event.node for event in lenient.publisher.published} == {"/ns/robot"}
    assert all(event.stamp.sec > 0 for event in lenient.publisher.published)


@given(st.lists(st.dictionaries(st.sampled_from("abc"), st.none() | st.integers(0, 9))))
def test_parameter_events_carry_every_value(settings):
    node, followed = FakeNode(allow=True), {}
    for values in settings:
        node.try_set(**values)
    for event in node.publisher.published:
        assert not followed.keys() & {one.name for one in event.new_parameters}
        assert followed.keys() >= {one.name for one in event.changed_parameters}
        for one in [*event.new_parameters, *event.changed_parameters]:
            followed[one.name] = one.value.integer_value
        for one in event.deleted_parameters:
            followed.pop(one.name, None)
    assert {name: one.value for name, one in node.get_parameters_by_prefix("").items()} == followed


def test_what_is_refused_is_not_published(node):
    node.declare_parameter("a", 1)
    node.try_set(a="x")
    assert len(node.publisher.published) == 1


NAMES = ["a", "g.a", "g.b", "g.h.a", "g.h.i.a", "ga"]


@pytest.mark.parametrize(
    ("prefixes", "depth", "names"),
    [
        ([], 0, NAMES),
        ([], 1, ["a", "ga"]),
        ([], 2, ["a", "g.a", "g.b", "ga"]),
        (["g"], 0, ["g.a", "g.b", "g.h.a", "g.h.i.a"]),
        (["g"], 1, ["g.a", "g.b"]),
        (["g.h", "a"], 1, ["a", "g.h.a"]),
        (["x"], 0, []),
    ],
)
def test_names_are_listed_by_prefix_and_depth(node, prefixes, depth, names):
    node.declare_parameters("", [(name, 1) for name in NAMES])
    found = node.list_parameters(prefixes, depth)
    assert found.names == names
    groups = {name.rpartition(".")[0] for name in names if "." in name}
    assert (set(found.prefixes), len(found.prefixes)) == (groups, len(groups))


@pytest.mark.parametrize(
    ("prefixes", "depth", "error"),
    [("a", 0, TypeError), ([1], 0, TypeError), ([], "0", TypeError), ([], -1, ValueError)],
)
def test_a_listing_needs_a_list_and_a_depth(node, prefixes, depth, error):
    with pytest.raises(error, match=r"prefixes|depth"):
        node.list_parameters(prefixes, depth)


def test_a_group_is_had_by_its_prefix(node):
    node.declare_parameters("", [("g.a", 1), ("g.b.c", 2), ("ga", 3)])
    found = node.get_parameters_by_prefix("g")
    assert {name: one.value for name, one in found.items()} == {"a": 1, "b.c": 2}
    assert set(node.get_parameters_by_prefix("")) == {"g.a", "g.b.c", "ga"}
    assert [one.value for one in node.get_parameters(["ga", "g.a"])] == [3, 1]


def test_a_descriptor_has_the_parameter_s_name_and_type(node):
    node.declare_parameter("a", "x", Descriptor(name="other", type=2, description="d"))
    assert node.describe_parameters(["a"]) == [Descriptor(name="a", type=4, description="d")]


def test_a_descriptor_can_be_replaced_by_one_that_fits(node):
    node.declare_parameter("a", 5)
    value = node.set_descriptor("a", Descriptor(dynamic_typing=True, description="new"))
    assert value.integer_value == 5
    assert node.describe_parameter("a").description == "new"
    ten_up = Descriptor(type=2, integer_range=[IntegerRange(from_value=10, to_value=20)])
    with pytest.raises(exceptions.InvalidParameterValueException):
        node.set_descriptor("a", ten_up)
    twelve = ParameterValue(type=2, integer_value=12)
    assert node.set_descriptor("a", ten_up, twelve).integer_value == 12
    assert node.value("a") == 12
    with pytest.raises(exceptions.ParameterNotDeclaredException):
        node.set_descriptor("b", Descriptor())
