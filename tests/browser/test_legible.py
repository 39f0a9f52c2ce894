"""Everything on the live page can be read at the size of a projector and of a laptop."""

from __future__ import annotations

import pytest

from tests.browser.chromium import PHONE
from tests.browser.legible import SIZES, all_faults, faults

LOOKS = {
    "projector": {"query": "?projector"},
    "only to see": {},
    "with buttons": {"control": True},
}
TARGETS = ("1.2,1.2", "warehouse", "station_1", "central", "area_a", "dock")


def submit(services):
    """Queue more tasks than fit; one of them ends."""
    for number in range(24):
        services.submit("scan", TARGETS[number % len(TARGETS)], 1 + number % 10)
    services.call("/cancel", task_id=4)


def test_page_without_tasks_can_be_read(start_server, open_page):
    server = start_server()
    for look, settings in LOOKS.items():
        page = open_page(server, size=SIZES["projector"], **settings)
        found = all_faults(page.tab, look)
        assert not found, "\n".join(found)


@pytest.mark.parametrize("look", LOOKS)
def test_page_with_many_tasks_can_be_read(busy, services, open_page, look):
    page = open_page(busy, size=SIZES["projector"], **LOOKS[look])
    page.agrees(services, until=lambda shown: shown.running is not None and len(shown.ended) == 1)
    found = all_faults(page.tab, look)
    assert not found, "\n".join(found)


def test_phone_shows_all_tasks_because_the_page_scrolls(busy, services, open_page):
    page = open_page(busy, size=PHONE, control=True)
    page.agrees(services, until=lambda shown: len(shown.queue) == 22)
    assert len([row for row in page.tab.all("#queue .row") if row.is_displayed()]) == 22
    assert not page.tab.shows("#queue_more:not(:empty)")


def test_button_shows_the_tasks_that_do_not_fit(busy, services, open_page):
    page = open_page(busy, size=SIZES["laptop"])
    tab = page.tab
    page.agrees(services, until=lambda shown: len(shown.queue) == 22)
    shown = "return [...document.querySelectorAll('#queue .row')].filter(e => !e.hidden).length"
    few = tab.run(shown)
    assert tab.text("#queue_more") == f"and {22 - few} more tasks"
    assert tab.text("#next_text").startswith("22 queued")
    tab.click("#queue_more")
    tab.wait(lambda: tab.text("#queue_more") == "Show fewer", "all tasks")
    assert tab.run(shown) == 22
    tab.click("#queue_more")
    tab.wait(lambda: tab.run(shown) == few, "the tasks that fit")
    tab.run("[...document.querySelectorAll('#queue .row:not([hidden])')].at(-1).focus()")
    tab.keys("j")
    tab.wait(lambda: tab.run(shown) == 22, "the next task to appear")


PLANTED = {
    "covers": """
        const [label, other] = [find('[data-place=central]'), find('[data-place=area_a]')];
        for (const name of ['x', 'y']) label.setAttribute(name, other.getAttribute(name));
    """,
    "on a wall": """
        const walls = [...document.querySelectorAll('#map .walls polygon')].map(e => e.getBBox());
        const wall = walls.sort((a, b) => b.width * b.height - a.width * a.height)[0];
        const label = find('[data-place=central]');
        label.setAttribute('x', wall.x + wall.width / 2);
        label.setAttribute('y', wall.y + wall.height / 2);
    """,
    "the edge": "find('[data-place=central]').setAttribute('x', find('.floor').getBBox().x)",
    "cut": "find('#now_title').style.width = '5rem'",
}


@pytest.mark.parametrize("planted", PLANTED)
def test_measuring_finds_a_planted_fault(busy, services, open_page, planted):
    tab = open_page(busy, size=SIZES["projector"], query="?projector").tab
    tab.wait(lambda: tab.shows("#now_title"), "the task that runs")
    assert faults(tab) == []
    tab.run(f"const find = css => document.querySelector(css); {PLANTED[planted]}")
    assert any(planted in each for each in faults(tab))
