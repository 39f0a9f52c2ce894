"""What the live page shows, read from its elements, in the terms of the task server's services."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from tests.browser.chromium import Tab
from tests.browser.task_server import Services

# All of it is read at one instant, so that no event can come between two parts.
_READ = """
const text = (node, css) => node.querySelector(css)?.textContent.trim() ?? "";
const all = css => [...document.querySelectorAll(css)];
const now = document.getElementById("now");
return {
    connection: document.getElementById("connection").dataset.state,
    paused: /paused/.test(document.getElementById("next_text").textContent + now.innerText),
    running: now.dataset.task === undefined ? null : {
        task_id: Number(now.dataset.task),
        text: text(now, "#now_title"),
        facts: text(now, "#now_facts"),
        state: now.querySelector(".state").dataset.state,
    },
    queue: all("#queue .row").map(row => ({
        task_id: Number(row.dataset.task),
        what: text(row, ".what"),
        priority: Number(text(row, ".priority_value")),
        client: text(row, ".client"),
        state: row.dataset.state,
    })),
    ended: all("#ended > li").map(row => ({
        task_id: Number(row.dataset.task),
        text: text(row, ".link"),
        client: text(row, ".client"),
        state: row.dataset.state,
    })),
};
"""
_BEGUN = ("RUNNING", "PAUSED", "CANCELING")


class Shown(NamedTuple):
    """The tasks as the page shows them, or as the services list them."""

    paused: bool
    running: tuple[int, str, str, int, str] | None
    """Number, text, state, priority and client."""
    queue: list[tuple[int, str, str, int, str]]
    ended: list[tuple[int, str, str, str]]
    """Number, text, state and client; newest first."""


class LivePage:
    """The live page in a tab."""

    def __init__(self, tab: Tab) -> None:
        self.tab = tab

    def read(self) -> dict[str, Any]:
        """Return what the elements say."""
        return dict(self.tab.run(_READ))

    def shown(self) -> Shown:
        """Return the tasks that the page shows."""
        read = self.read()
        running = None
        if (now := read["running"]) is not None:
            facts = now["facts"].split(" · ")
            what = now["text"].removeprefix(f"task {now['task_id']}").strip()
            priority = int(facts[0].removeprefix("priority "))
            running = (now["task_id"], what, now["state"], priority, facts[1])
        queue = [
            (row["task_id"], row["what"], row["state"], row["priority"], row["client"])
            for row in read["queue"]
        ]
        ended = [
            (
                row["task_id"],
                row["text"].removeprefix(f"task {row['task_id']}").strip(),
                row["state"],
                row["client"],
            )
            for row in read["ended"]
        ]
        return Shown(read["paused"], running, queue, ended)

    def is_live(self) -> LivePage:
        """Wait until the page is connected."""
        self.tab.wait(lambda: self.read()["connection"] == "live", "the connection to be live")
        return self

    def agrees(self, services: Services, *, until: Callable[[Shown], bool] | None = None) -> Shown:
        """Wait until the page shows what the services say, and a condition holds for both."""
        last = (None, None)

        def agreed() -> Shown | None:
            nonlocal last
            shown, listed = last = self.shown(), listed_by(services)
            return shown if shown == listed and (until is None or until(shown)) else None

        try:
            return self.tab.wait(agreed, "the page to agree with the services")
        except AssertionError as error:
            raise AssertionError(f"shown  {last[0]}\nlisted {last[1]}\n{error}") from error

    def said(self) -> str:
        """Return what the page says of the newest button, as soon as it says anything."""
        return self.tab.wait(lambda: self.tab.text("#control_text"), "a text of the controls")


def listed_by(services: Services) -> Shown:
    """Return the tasks as the service `/robot_task/list` lists them."""
    response = services.call("/list", all=True, limit=1000)
    rows = [
        (task.task_id, f"{task.task_type} {task.target}", task.state, task.priority, task.client)
        for task in response.tasks
    ]
    begun = [row for row in rows if row[2] in _BEGUN]
    queue = [row for row in rows if row[2] == "QUEUED"]
    ended = [(*row[:3], row[4]) for row in rows if row[2] not in (*_BEGUN, "QUEUED")]
    return Shown(response.paused, begun[0] if begun else None, queue[:50], ended[:30])
