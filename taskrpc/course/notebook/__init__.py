"""taskrpc in Jupyter: `%load_ext taskrpc.course.notebook` in the first cell of a notebook.

After that, a cell can be run again: its nodes replace those of its last run. Errors of taskrpc take
one line. The functions here spin nodes in the background and show the robot. `session` has what a
notebook has once, `nodes` replaces nodes, `live` and `picture` draw, `labs` has the files of a lab,
and only `jupyter` uses IPython. Nothing else in taskrpc imports this package.
"""

from __future__ import annotations

from typing import Any

from taskrpc.course.notebook.session import session

__all__ = [
    "check",
    "lab",
    "load_ipython_extension",
    "run",
    "spin",
    "start",
    "start_robot",
    "stop",
    "stop_robot",
    "view",
]


def load_ipython_extension(ipython: Any) -> None:
    """Prepare a notebook; `%load_ext taskrpc.course.notebook` calls it."""
    session()


def spin(node: Any) -> None:
    """Run the callbacks of a node of rclpy in the background, while other cells run.

    Another cell may still spin the same node, for example with `rclpy.spin_until_future_complete`.
    If a callback raises, its traceback is printed and the node continues. Destroying the node, or
    replacing it, ends the background spinning.
    """
    session().spin(node)


def view(seconds: float | None = None) -> None:
    """Show the map with the robot, the queue of the task server, and the last calls.

    The picture follows the robot until another `view()`. With `seconds`, the cell waits for so long
    and the picture then stays as it is, which suits a notebook that is executed as a whole. Outside
    of Jupyter, it prints the present state as text.
    """
    session().view(seconds)


def start_robot(speed: float = 1.0, map: str = "") -> None:
    """Start a simulated robot with its task server `/robot_task` inside of this notebook.

    A second call starts it again, with an empty queue.

    Args:
        speed: robot seconds that pass in one real second.
        map: the path of a map file; "" for the bundled map.

    Raises NameInUse if another program offers `/robot_task`: the robot of that program can be used.
    """
    session().start_robot(speed, map)


def stop_robot() -> None:
    """Stop the robot of `start_robot`; its tasks are forgotten."""
    session().stop_robot()


def lab(number: int) -> None:
    """Begin or continue a lab of the course, in the folder `labN` beside the notebook.

    From then on, a cell that begins with `%%lab FILE` is this file of the lab: it is written into
    the folder. A Python file then also runs in the notebook, without `main()`. A definition is
    checked, and imports use it from now on.
    """
    session().lab(number)


def check() -> None:
    """Check the lab of this notebook, as `taskrpc lab check` does."""
    session().begun_lab().check()


def run(file: str, *arguments: object) -> None:
    """Run a file of the lab as a program of its own, and show its output until it ends.

    Interrupting the cell ends the program, as Ctrl-C does in a terminal.
    """
    session().begun_lab().run(file, [str(each) for each in arguments])


def start(file: str, *arguments: object) -> None:
    """Start a file of the lab as a program of its own, in the background.

    What it prints appears below the cell that runs at that moment. It runs until `stop(file)`,
    until it is started again, or until the kernel ends.
    """
    session().begun_lab().start(file, [str(each) for each in arguments])


def stop(file: str) -> None:
    """End the program of a file, as Ctrl-C does in a terminal."""
    session().begun_lab().stop(file)
