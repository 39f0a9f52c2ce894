"""The same program with other names is recognised; another program is not."""

import pytest

from taskrpc.course.labs.similarity import structure
from tests.labs.submissions import LECTURERS, solution_of

PROGRAM = b'''
import rclpy
from rclpy.node import Node


class Adder(Node):
    """Adds."""

    def add(self, request, response):
        response.sum = request.a + request.b  # the sum
        self.get_logger().info(f"{request.a} + {request.b}")
        return response


def main(args=None):
    node = Adder("adder")
    rclpy.spin(node=node)
'''


@pytest.mark.parametrize(
    "changes",
    [
        [(b"Adder(", b"Server("), (b"def add", b"def plus")],
        [(b"request", b"req"), (b"response", b"answer")],
        [(b"    node = A", b"    thing = A"), (b"node=node", b"node=thing")],
        [(b"  # the sum", b""), (b'    """Adds."""\n', b'    "It is mine."\n')],
        [(b'"adder"', b"'adder'"), (b"\n\n\n", b"\n"), (b" + request.b  #", b"  +  request.b #")],
    ],
)
def test_other_names_comments_and_layout_are_the_same_program(changes):
    changed = PROGRAM
    for old, new in changes:
        assert old in changed
        changed = changed.replace(old, new)
    assert changed != PROGRAM
    assert structure(changed) == structure(PROGRAM)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"request.a + request.b  #", b"request.b + request.a  #"),
        (b"request.a + request.b  #", b"request.a - request.b  #"),
        (b'"adder"', b'"server"'),
        (b"        return response\n", b""),
        (b"node=node", b"node"),
    ],
)
def test_another_program_is_another_one(old, new):
    assert old in PROGRAM
    assert structure(PROGRAM.replace(old, new)) != structure(PROGRAM)


@pytest.mark.parametrize("source", [b"def f(:", b"\0", b"(" * 10_000, b"\xff", b"x = 1\n" * 10**5])
def test_what_is_no_program_stays_as_it_is(source):
    assert structure(source) == source


@pytest.mark.parametrize("number", range(2, 7))
def test_each_wrong_submission_is_another_program_than_the_solution(number):
    for path in solution_of(number).glob("*.py"):
        for wrong in (LECTURERS / f"lab{number}" / "wrong").glob(f"*/{path.name}"):
            assert structure(_filled(wrong)) != structure(_filled(path)), wrong


def _filled(path):
    return path.read_bytes().replace(b"@", b"_")
