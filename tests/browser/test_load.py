"""The live page stays small and readable with many tasks, many clients and many calls."""

from __future__ import annotations

import re

import pytest

from tests.browser.task_server import Services
from tests.faults.harness import HAPPENED

TASKS = 500
CLIENTS = 60
MOST_NODES = 3000
"""Most DOM nodes of the whole page; it shows at most 50 queued tasks, 30 ended ones, 100 calls."""

_COUNT_FRAMES = """
const begin = performance.now();
let frames = 0, longest = 0, last = begin;
return await new Promise(done => requestAnimationFrame(function frame(now) {
    frames += 1;
    longest = Math.max(longest, now - last);
    last = now;
    if (now - begin < 3000) requestAnimationFrame(frame);
    else done({frames: frames / (now - begin) * 1000, longest});
}));
"""


@pytest.fixture
def clients():
    """Sixty programs' nodes."""
    made = [Services(f"client_{number}") for number in range(CLIENTS)]
    for each in made:
        each.__enter__()
    yield made
    for each in made:
        each.__exit__()


@pytest.mark.slow
def test_five_hundred_tasks_of_sixty_clients_keep_the_page_small(
    start_server, services, open_page, clients, record_property
):
    server = start_server("--speed", "0.2")
    page = open_page(server, control=True)
    empty = page.tab.run("return document.querySelectorAll('*').length")
    for number in range(TASKS):
        clients[number % CLIENTS].submit("move", "warehouse", 1 + number % 10)
    page.agrees(services, until=lambda shown: len(shown.queue) == 50)
    measured = page.tab.run_async(_COUNT_FRAMES)
    for verb in ("/list", "/show"):  # calls of all clients while the page draws
        for each in clients:
            each.call(verb, **({"task_id": 1} if verb == "/show" else {}))
    busy = page.tab.run_async(_COUNT_FRAMES)
    nodes = page.tab.run("return document.querySelectorAll('*').length")
    for tab in ("list", "nodes"):
        page.tab.click(f"#tab_{tab}")
        nodes = max(nodes, page.tab.run("return document.querySelectorAll('*').length"))
    heap = page.tab.run("return performance.memory?.usedJSHeapSize ?? 0")
    told = (
        f"{measured['frames']:.0f} and {busy['frames']:.0f} frames/s, longest"
        f" {max(measured['longest'], busy['longest']):.0f} ms; {empty} to {nodes} nodes;"
        f" {heap / 1e6:.1f} MB of JavaScript objects"
    )
    record_property(HAPPENED, told)
    assert nodes <= MOST_NODES, told
    # The queue shows as many tasks as fit, at most 50; one task runs.
    more = re.fullmatch(r"and (\d+) more tasks", page.tab.text("#queue_more"))
    assert more is not None
    assert TASKS - 51 <= int(more[1]) < TASKS - 1


@pytest.mark.slow
def test_page_does_not_grow_while_tasks_come_and_go(start_server, services, open_page):
    page = open_page(start_server("--speed", "1000", "--settle", "0"))
    sizes = []
    for _ in range(3):
        last = [services.submit("move", target) for target in ("1,1", "1.1,1.1") * 40][-1]
        page.agrees(services, until=lambda shown: shown.ended and shown.ended[0][0] == last)  # noqa: B023
        drawn = "#calls .moving > g:first-of-type > *"
        page.tab.wait(lambda: not page.tab.all(drawn), "the calls to leave the drawing")  # noqa: B023
        sizes.append(page.tab.run("return document.querySelectorAll('*').length"))
    assert max(sizes) <= sizes[0] + 30, sizes
