"""Parameters: the order of callbacks, ranges, undeclared ones, prefixes and overrides."""

import rclpy
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.parameter import Parameter
from shared import attempt, end


def results(node, *given):
    """The results of setting parameters."""
    return [(one.successful, one.reason) for one in node.set_parameters(list(given))]


def callbacks(node):
    order = []

    def before(given):
        order.append(("before", [each.name for each in given]))
        return [*given, Parameter("added", value=1)] if given[0].name == "first" else given

    def check(name, refused):
        def run(given):
            order.append((name, [(each.name, each.value) for each in given]))
            reason = f"{name} refuses"
            return SetParametersResult(successful=given[0].value != refused, reason=reason)

        return run

    def after(given):
        order.append(("after", [each.name for each in given]))

    node.declare_parameter("first", 1)
    node.declare_parameter("added", 0)
    one, two = check("one", 13), check("two", 14)
    node.add_pre_set_parameters_callback(before)
    node.add_on_set_parameters_callback(one)
    node.add_on_set_parameters_callback(two)
    node.add_post_set_parameters_callback(after)
    for value in (2, 13, 14):
        attempt(f"set {value}", lambda value=value: results(node, Parameter("first", value=value)))
        print("order", order, flush=True)
        order.clear()
    attempt("value", lambda: node.get_parameter("first").value)
    attempt("declare", lambda: node.declare_parameter("declared", 5).value)
    print("order", order, flush=True)
    order.clear()
    attempt("declare refused", lambda: node.declare_parameter("refused", 13).value)
    order.clear()
    attempt("remove", lambda: node.remove_on_set_parameters_callback(one))
    attempt("remove again", lambda: node.remove_on_set_parameters_callback(one))
    node.remove_on_set_parameters_callback(two)
    node.remove_pre_set_parameters_callback(before)
    node.remove_post_set_parameters_callback(after)
    attempt("set 13 later", lambda: results(node, Parameter("first", value=13)))
    print("order", order, flush=True)
    node.add_on_set_parameters_callback(lambda given: None)
    attempt("callback of None", lambda: results(node, Parameter("first", value=15)))


def ranges(node):
    within = ParameterDescriptor(
        integer_range=[IntegerRange(from_value=0, to_value=10, step=3)], description="steps"
    )
    node.declare_parameter("steps", 3, within)
    for value in (0, 3, 4, 10, 9, 11, -1, 2.0, "a", None):
        attempt(
            f"steps {value!r}", lambda value=value: results(node, Parameter("steps", value=value))
        )
    floats = ParameterDescriptor(
        floating_point_range=[FloatingPointRange(from_value=0.0, to_value=1.0, step=0.25)]
    )
    node.declare_parameter("part", 0.5, floats)
    for value in (0.0, 0.25, 0.3, 1.0, 1.1, 1, float("nan")):
        attempt(
            f"part {value!r}", lambda value=value: results(node, Parameter("part", value=value))
        )
    attempt("declared outside", lambda: node.declare_parameter("outside", 50, within))
    attempt(
        "declared with another type", lambda: node.declare_parameter("typed", "a", within).value
    )
    attempt("described", lambda: node.describe_parameter("steps").integer_range)
    attempt("new descriptor", lambda: node.set_descriptor("steps", ParameterDescriptor()).name)
    attempt("unknown described", lambda: node.describe_parameter("nothing"))
    attempt(
        "describe several",
        lambda: [each.name for each in node.describe_parameters(["steps", "part"])],
    )


def declarations(node):
    attempt("without value", lambda: node.declare_parameter("empty").value)
    attempt(
        "dynamic",
        lambda: node.declare_parameter("any", None, ParameterDescriptor(dynamic_typing=True)).value,
    )
    attempt("of a type", lambda: node.declare_parameter("typed1", Parameter.Type.INTEGER).value)
    attempt("get of a type", lambda: node.get_parameter("typed1").value)
    attempt("get or", lambda: node.get_parameter_or("typed1", Parameter("typed1", value=7)).value)
    attempt(
        "get or unknown", lambda: node.get_parameter_or("unknown", Parameter("x", value=7)).value
    )
    attempt("get or nothing", lambda: node.get_parameter_or("unknown").value)
    attempt("override", lambda: node.declare_parameter("given", 1).value)
    attempt("ignored", lambda: node.declare_parameter("given2", 1, ignore_override=True).value)
    attempt("wrong override", lambda: node.declare_parameter("given3", 1).value)
    attempt("mixed list", lambda: node.declare_parameter("mixed", [1, "a"]))
    attempt("empty list", lambda: node.declare_parameter("list", []).type_.name)
    attempt("empty name", lambda: node.declare_parameter("", 1))
    attempt("odd name", lambda: node.declare_parameter("a b/c", 1).name)
    attempt("dots", lambda: node.declare_parameters("arm", [("x", 1), ("y.z", 2.0)])[1].name)
    attempt("by prefix", lambda: sorted(node.get_parameters_by_prefix("arm")))
    attempt("by no prefix", lambda: len(node.get_parameters_by_prefix("")) > 5)
    attempt("list", lambda: node.list_parameters(["arm"], 1).names)
    attempt(
        "deeper",
        lambda: (node.list_parameters(["arm"], 5).names, node.list_parameters(["arm"], 0).prefixes),
    )
    attempt("undeclare", lambda: node.undeclare_parameter("given"))
    attempt("undeclare again", lambda: node.undeclare_parameter("given"))
    attempt("set undeclared", lambda: results(node, Parameter("given", value=1)))
    attempt(
        "atomically",
        lambda: node.set_parameters_atomically(
            [Parameter("given2", value=2), Parameter("no", value=1)]
        ),
    )
    attempt("unchanged", lambda: node.get_parameter("given2").value)
    attempt("no parameter", lambda: node.set_parameters(["a"]))
    attempt("type of", lambda: node.get_parameter_type("given2").name)
    attempt("types", lambda: [each.name for each in node.get_parameter_types(["given2", "given3"])])


def undeclared():
    node = rclpy.create_node(
        "lenient",
        allow_undeclared_parameters=True,
        automatically_declare_parameters_from_overrides=True,
        parameter_overrides=[Parameter("a.b", value=1)],
    )
    attempt("automatic", lambda: node.get_parameter("a.b").value)
    attempt("undeclared", lambda: node.get_parameter("c").value)
    attempt("set unknown", lambda: results(node, Parameter("c", value="x")))
    attempt("has", lambda: (node.has_parameter("c"), node.has_parameter("d")))
    attempt("another type", lambda: results(node, Parameter("c", value=1)))
    attempt("deleted", lambda: results(node, Parameter("c", Parameter.Type.NOT_SET)))
    attempt("has", lambda: node.has_parameter("c"))


def values():
    for value in (
        True,
        1,
        2.5,
        "a",
        b"a",
        [True],
        [1],
        [1.5],
        ["a"],
        [b"a"],
        [],
        (1, 2),
        [1, 2.5],
        [1, True],
        None,
        2**63,
        {},
    ):
        attempt(f"value {value!r}", lambda value=value: Parameter("p", value=value).type_.name)
        attempt(
            f"as message {value!r}",
            lambda value=value: Parameter("p", value=value).to_parameter_msg().value.type,
        )
    attempt("wrong type", lambda: Parameter("p", Parameter.Type.INTEGER, "a"))
    attempt("type only", lambda: Parameter("p", Parameter.Type.STRING).value)
    attempt("no type", lambda: Parameter("p", 1, 1))
    attempt("text", lambda: repr(Parameter("p", value=1).value))


rclpy.init()
node = rclpy.create_node(
    "parameters",
    parameter_overrides=[
        Parameter("given", value=5),
        Parameter("given2", value=5),
        Parameter("given3", value="text"),
    ],
)
ranges(node)
declarations(node)
callbacks(node)
undeclared()
values()
end()
