"""Jedi, which completes in many editors, knows the fields of classes after `srvgen stubs`."""

from __future__ import annotations

from pathlib import Path

import pytest

from srvgen.classes.stubs import packages_with_dependencies, stubs
from srvgen.files.search import BUNDLED, Search
from tests.srvgen.sample_definitions import put_all

pytestmark = [pytest.mark.types, pytest.mark.real_time]

SERVICE = "int32 count\n---\nmy_msgs/Route route\n"
ROUTE = """
geometry_msgs/Point[] points
geometry_msgs/Point[<=3] few
geometry_msgs/Point[2] two
string[<=3] names
float64[<=3] numbers
builtin_interfaces/Time stamp
"""
NUMBERS = ["x", "y", "z"]
COMPLETED = {
    "request = Plan.Request()\nrequest.": ["count"],
    "def plan(request: Plan.Request, response: Plan.Response):\n    response.": ["route"],
    "Plan.Response().route.stamp.": ["nanosec", "sec"],
    "Plan.Response().route.points[0].": NUMBERS,
    "Plan.Response().route.few[0].": NUMBERS,
    "for point in Plan.Response().route.few:\n    point.": NUMBERS,
    "Plan.Response().route.two[1].": NUMBERS,
    "Plan.Response().route.names[0].upp": ["upper"],
    "Plan.Response().route.numbers[0].is_int": ["is_integer"],
    "goal = Fibonacci.Goal()\ngoal.": ["order"],
}


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    import jedi  # of the extra `dev`; the other suites collect this file too

    folder = tmp_path_factory.mktemp("project")
    put_all({"my_msgs/srv/Plan.srv": SERVICE, "my_msgs/msg/Route.msg": ROUTE}, folder)
    search = Search([folder, BUNDLED])
    needed, errors = packages_with_dependencies(["my_msgs", "example_interfaces"], search)
    assert not errors
    put_all(stubs(needed), folder / "typings")
    return jedi.Project(folder, added_sys_path=[str(folder / "typings")])


@pytest.mark.parametrize("text", COMPLETED)
def test_an_editor_completes_the_fields(project, text):
    import jedi

    program = (
        "from example_interfaces.action import Fibonacci\nfrom my_msgs.srv import Plan\n" + text
    )
    script = jedi.Script(program, path=Path(project.path) / "program.py", project=project)
    lines = program.split("\n")
    found = [each.name for each in script.complete(len(lines), len(lines[-1]))]
    fields = [name for name in found if not name.startswith("_")]
    of_every_message = "get_fields_and_field_types"
    assert [name for name in fields if name != of_every_message] == COMPLETED[text]
