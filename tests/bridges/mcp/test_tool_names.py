"""The names of tools: valid, stable, and never shared."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.bridges.mcp.tool_names import LONGEST, action_tool_name, tool_name

TOKENS = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,6}", fullmatch=True)
NAMES = st.lists(TOKENS, min_size=1, max_size=12).map(lambda tokens: "/" + "/".join(tokens))


@pytest.mark.parametrize(
    ("service", "expected"),
    [
        ("/robot_task", "robot_task"),
        ("/robot_task/list", "robot_task-list"),
        ("/a/_b/c__d", "a-_b-c__d"),
        (f"/{'a' * 48}", "a" * 48),
        (f"/{'a' * 49}", "a" * 32 + "-08f9bec6a62dd28"),
    ],
)
def test_name_of_a_service_becomes_this_name_of_a_tool(service, expected):
    assert tool_name(service) == expected


def test_action_and_service_of_one_name_are_two_tools():
    assert action_tool_name("/lift") == "lift--goal" != tool_name("/lift")


@given(NAMES, NAMES)
def test_two_names_never_share_a_tool(one, other):
    tools = [tool_name(one), action_tool_name(one), tool_name(other), action_tool_name(other)]
    assert len(set(tools)) == (4 if one != other else 2)
    assert all(re.fullmatch(rf"[A-Za-z0-9_-]{{1,{LONGEST}}}", each) for each in tools)
