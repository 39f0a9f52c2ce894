"""A definition is shown with its nested definitions, in the format of `ros2 interface show`."""

import pytest

from srvgen.describe import show
from srvgen.files.reading import parse_definition

TEXTS = {
    "my_msgs/srv/Fetch": (
        "# Fetches.\n\nThing thing  # what\n---\n# Says.\nThing[<=3] found\nbool OK=true # yes\n"
    ),
    "my_msgs/msg/Thing": "# A thing.\nPart part # inside\n\nstring name\n",
    "my_msgs/msg/Part": "int32 id 3   # a number\n# The end.\n",
}


def lookup(name):
    package, kind, bare = name.split("/")
    return TEXTS[name], parse_definition(TEXTS[name], package, kind, bare)


EXPECTED = {
    "own": """\
# Fetches.

Thing thing  # what
\tPart part
\t\tint32 id 3
\tstring name
---
# Says.
Thing[<=3] found
\tPart part
\t\tint32 id 3
\tstring name
bool OK=true # yes
""",
    "none": """\
Thing thing
\tPart part
\t\tint32 id 3
\tstring name
---
Thing[<=3] found
\tPart part
\t\tint32 id 3
\tstring name
bool OK=true
""",
    "all": """\
# Fetches.

Thing thing  # what
\t# A thing.
\tPart part # inside
\t\tint32 id 3   # a number
\t\t# The end.

\tstring name
---
# Says.
Thing[<=3] found
\t# A thing.
\tPart part # inside
\t\tint32 id 3   # a number
\t\t# The end.

\tstring name
bool OK=true # yes
""",
}


@pytest.mark.parametrize("comments", EXPECTED)
def test_nested_definitions_are_indented_and_comments_are_kept_as_requested(comments):
    lines = show("my_msgs/srv/Fetch", lookup, comments=comments)
    assert "".join(f"{line}\n" for line in lines) == EXPECTED[comments]
