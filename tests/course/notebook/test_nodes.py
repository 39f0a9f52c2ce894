import pytest

import srvgen
import taskrpc
from taskrpc.course.notebook.nodes import NotebookNodes

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")


@pytest.fixture
def nodes(monkeypatch):
    nodes = NotebookNodes()
    monkeypatch.setattr(taskrpc.Node, "default_observer", nodes)
    return nodes


async def server(name, total):
    """A node as a cell makes it: nothing closes it."""
    node = taskrpc.Node(name, transport="memory")
    await node.start()

    def add(request, response):
        response.sum = total
        return response

    node.create_service(AddTwoInts, "add", add)
    return node


async def answer():
    observer = taskrpc.Observer()
    async with taskrpc.Node("asking", transport="memory", observer=observer) as node:
        client = node.create_client(AddTwoInts, "add", timeout=1.0)
        return (await client.call(AddTwoInts.Request())).sum


async def test_new_node_replaces_the_earlier_one_of_its_name(nodes):
    await server("adder", 1)
    last = await server("adder", 2)
    assert await answer() == 2
    await last.destroy()


async def test_cell_that_runs_again_replaces_its_node_under_another_name(nodes):
    nodes.cell_begins("a")
    await server("adder", 1)
    nodes.cell_begins("b")
    nodes.cell_begins("a")
    last = await server("renamed", 2)
    assert await answer() == 2
    await last.destroy()


async def test_node_of_another_cell_stays(nodes):
    nodes.cell_begins("a")
    first = await server("adder", 1)
    nodes.cell_begins("b")
    with pytest.raises(taskrpc.NameInUse):
        await server("other", 2)
    assert await answer() == 1
    await first.destroy()


async def test_at_a_prompt_only_the_name_decides(nodes):
    nodes.cell_begins("")
    first = await server("adder", 1)
    nodes.cell_begins("")
    assert await answer() == 1
    await first.destroy()


async def test_node_with_an_observer_of_its_own_is_left_alone(nodes):
    first = taskrpc.Node("same", transport="memory", observer=taskrpc.Observer())
    await first.start()
    async with taskrpc.Node("same", transport="memory", observer=taskrpc.Observer()):
        assert first.get_name() == "same"
    assert nodes.newest() == []
    await first.destroy()


async def test_calls_are_kept(nodes):
    node = await server("adder", 1)
    await answer()
    assert [(call.caller, call.service) for call in nodes.newest()] == [("/asking", "/add")]
    await node.destroy()


class RclpyNode:
    def __init__(self, nodes, name):
        self.destroyed = False
        nodes.node_joins(self, name)

    def destroy_node(self):
        self.destroyed = True


def test_rclpy_node_is_replaced_by_name_and_by_cell(nodes):
    left = []
    nodes.leaves = left.append
    nodes.cell_begins("a")
    first, other = RclpyNode(nodes, "/adder"), RclpyNode(nodes, "/other")
    nodes.cell_begins("b")
    second = RclpyNode(nodes, "/adder")
    assert (first.destroyed, other.destroyed, second.destroyed) == (True, False, False)
    nodes.cell_begins("a")
    assert (other.destroyed, second.destroyed) == (True, False)
    assert left == [first, other]
