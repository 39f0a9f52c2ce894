"""Writes `docs/explanation/mistakes.md`: `python -m tests.simulation.mistakes_page`.

The page has each mistake of `systems/mistakes` with its story, as `taskrpc simulate` prints it.
"""

from __future__ import annotations

import ast
import re
import textwrap
from pathlib import Path
from typing import NamedTuple

from taskrpc.simulation.search.protocol import Explain
from taskrpc.simulation.search.search import WorkerProcess
from taskrpc.simulation.search.story import lines_of, story

SYSTEMS = Path(__file__).parent / "systems" / "mistakes"
PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "mistakes.md"
_MARKS = re.compile(r"^\s+[~^]+\n", re.M)
"""The marks below a line of a traceback; each version of Python has its own."""


class Mistake(NamedTuple):
    """One mistake of the page."""

    name: str
    title: str
    seed: int
    """A seed with a short story."""
    file: str
    function: str
    """The function with the mistake; "" for the statements of the file."""
    cure: str


INTRODUCTION = """\
# Mistakes that a simulation finds

These small systems have one mistake each, and most of them work when you try them once.
`taskrpc simulate` found each mistake, left out every fault that the failure does not need, and
printed the story below. [Simulate a robot system](../how-to/simulate-a-robot-system.md) shows how
to read one. The systems are in `tests/simulation/systems/mistakes`.
"""

SECTIONS: dict[str, list[Mistake]] = {
    "Lost requests and responses": [
        Mistake(
            "retry_without_id",
            "A retry without a request id",
            1,
            "student.py",
            "main",
            "Offer the service with `exactly_once`, and pass the same `request_id` to each attempt:"
            " [Run a call exactly once](../how-to/run-once.md).",
        ),
        Mistake(
            "lost_response_is_failure",
            "A lost response taken for a failure",
            11,
            "shop.py",
            "sell",
            "After a timeout, the outcome is unknown. Ask the robot whether it has the order, or"
            " repeat the order with its id, before you pay back.",
        ),
        Mistake(
            "unchecked_future",
            "A future whose exception nobody reads",
            17,
            "student.py",
            "main",
            "Call `future.result()` in the callback. It raises what ended the call.",
        ),
        Mistake(
            "no_timeout",
            "A wait without a timeout",
            5,
            "student.py",
            "main",
            "Give `spin_until_future_complete` a `timeout_sec`, and handle a future that is not"
            " done.",
        ),
        Mistake(
            "broken_chain",
            "A chain of calls that ends with one response",
            65,
            "patrol.py",
            "drive",
            "Let a timer look whether the response is late, and send the request again.",
        ),
        Mistake(
            "short_deadline",
            "A deadline that is too short",
            2,
            "robot.py",
            "carry",
            "Open the gripper in a `finally` block, which also runs if the caller's deadline ends"
            " the work. Choose a deadline that is longer than the longest work.",
        ),
        Mistake(
            "cancel_while_succeeding",
            "A cancellation that comes too late",
            0,
            "student.py",
            "main",
            "Await `goal.result()` after `goal.cancel()`. It raises `GoalCanceled` only if the goal"
            " was cancelled.",
        ),
    ],
    "Crashes and restarts": [
        Mistake(
            "crash_before_note",
            "Work that is noted after it is done",
            11,
            "robot.py",
            "pour",
            "Note the order before you pour, as begun. After a restart, look at the cup for an"
            " order that has begun and has not ended.",
        ),
        Mistake(
            "forgets_its_state",
            "State in a variable",
            12,
            "shop.py",
            "__init__",
            "Keep the stock in a file or a database, and write it before you respond.",
        ),
        Mistake(
            "stale_command",
            "A command that is delivered again",
            10,
            "robot.py",
            "__init__",
            "Use a service or an action for a command. A latched topic is for a state, such as a"
            " map.",
        ),
        Mistake(
            "waits_after_last_attempt",
            "A wait after the last attempt only",
            1,
            "student.py",
            "switch",
            "Wait between the attempts, each time longer: `RetryPolicy` does it.",
        ),
    ],
    "Starts and first messages": [
        Mistake(
            "no_wait_for_service",
            "A call before the server has started",
            1,
            "student.py",
            "",
            "Call `client.wait_for_service()` before the first call.",
        ),
        Mistake(
            "missed_first_message",
            "A message before its subscriber has started",
            17,
            "mapper.py",
            "",
            "Publish the map with the durability `TRANSIENT_LOCAL`, and subscribe with it.",
        ),
        Mistake(
            "exception_in_callback",
            "A callback that expects a message",
            61,
            "robot.py",
            "grasp",
            "Respond with `success = False` while `self.seen` is None.",
        ),
        Mistake(
            "assumes_new_message",
            "A mean of no messages",
            20,
            "odometry.py",
            "compute",
            "Return at once if `self.turns` is empty.",
        ),
        Mistake(
            "retry_storm",
            "A retry at once and without end",
            0,
            "student.py",
            "",
            "Wait between the attempts, each time longer, and stop after some of them:"
            " `RetryPolicy` does it.",
        ),
    ],
    "Two at the same time": [
        Mistake(
            "check_then_act",
            "A question, and then an action",
            20,
            "forklift.py",
            "main",
            "Let one service do both: `take` takes the cell if it is free, and says whether it"
            " did.",
        ),
        Mistake(
            "shared_counter",
            "A counter of several callbacks",
            5,
            "counter.py",
            "ticket",
            "Use a `MutuallyExclusiveCallbackGroup`, or hold a lock from reading to writing.",
        ),
        Mistake(
            "two_locks",
            "Two locks in opposite order",
            2,
            "robot.py",
            "unload",
            "Take both locks in the same order everywhere.",
        ),
        Mistake(
            "two_robots_in_cell",
            "A reset that forgets who is inside",
            10,
            "cell.py",
            "pause",
            "Do not change `is_taken` at a pause: only the robot inside may free the cell.",
        ),
    ],
    "Callbacks and loops that wait": [
        Mistake(
            "call_in_callback",
            "A call that waits in a callback",
            0,
            "robot.py",
            "fetch",
            "Make the callback `async`, await `self.arm.call_async(...)`, and create the client in"
            " a `ReentrantCallbackGroup`.",
        ),
        Mistake(
            "busy_wait",
            "A loop that lets nobody else run",
            0,
            "student.py",
            "",
            "Call `rclpy.spin_until_future_complete(node, future)` instead of the loop.",
        ),
    ],
}


def page() -> str:
    """Return the text of the page."""
    parts = [INTRODUCTION]
    for title, mistakes in SECTIONS.items():
        parts += [f"\n## {title}\n", *(_section(each) for each in mistakes)]
    return "".join(parts)


def _section(mistake: Mistake) -> str:
    folder = SYSTEMS / mistake.name
    scenario = folder / f"{mistake.name}.sim.py"
    about = ast.get_docstring(ast.parse(scenario.read_text(encoding="utf-8")))
    code = _code(folder / mistake.file, mistake.function)
    with WorkerProcess() as worker:
        worker.load(scenario)
        found = worker.ask(Explain(mistake.seed))
    told = story(found, lines_of(found, folder)).replace(f"{folder}/", "")
    return f"""
### {mistake.title}

{_wrapped(f"{about} In `{mistake.file}`:")}

```text
{code}
```

```text
{_MARKS.sub("", told)}
```

{_wrapped(mistake.cure)}
"""


def _wrapped(text: str) -> str:
    return textwrap.fill(text, 118, break_long_words=False, break_on_hyphens=False)


def _code(file: Path, function: str) -> str:
    """Return the lines of a function, or of a file without its imports."""
    text = file.read_text(encoding="utf-8")
    tree = ast.parse(text)
    if not function:
        body = [each for each in tree.body if not isinstance(each, ast.Import | ast.ImportFrom)]
        return "\n".join(text.splitlines()[body[0].lineno - 1 :])
    [found] = (
        each
        for each in ast.walk(tree)
        if isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef) and each.name == function
    )
    lines = text.splitlines()[found.lineno - 1 : found.end_lineno]
    return "\n".join(line[found.col_offset :] for line in lines)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
