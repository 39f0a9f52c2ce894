"""Turns the errors of launch files into one line with the location and the next step."""

from __future__ import annotations

from taskrpc.ros.executables import missing_package
from taskrpc.ros.missing import explain_program

from .locations import location_of

_CLONE = "clone the repository of the package into the src folder of your workspace"


def explained(error: BaseException) -> str:
    """One line about an error, with the line of the launch file where it happened."""
    if isinstance(error, SyntaxError):
        return f"{error.filename}, line {error.lineno}: {type(error).__name__}: {error.msg}"
    problem = str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)
    # A library may have several lines to say: the log has one line for each problem.
    problem = "; ".join(line.strip() for line in problem.splitlines() if line.strip())
    problem = problem or type(error).__name__
    if isinstance(error, RecursionError):
        problem = "too deep: a launch file includes itself, or a function calls itself without end"
    step = _next_step(error, problem)
    location = location_of(error)
    is_told = isinstance(error, (RuntimeError, FileNotFoundError))
    kind = "" if is_told or type(error).__name__ in problem else f"{type(error).__name__}: "
    front = f"{location}: {kind}" if location else ""
    return f"{front}{problem}{step}"


def _next_step(error: BaseException, problem: str) -> str:
    if package := _missing_in(problem):
        step = f"taskrpc does not have the package '{package}': {_CLONE}"
        return f"; {explain_program(package) or step}"
    if isinstance(error, ModuleNotFoundError) and ";" not in problem:
        return f"; if it belongs to a ROS package, {_CLONE}, otherwise install it with pip"
    if isinstance(error, KeyError) and problem.isidentifier() and problem.isupper():
        return f"; if it is an environment variable, set it before the launch: {problem}=VALUE"
    return ""


def _missing_in(problem: str) -> str:
    """The package that is not here and that a path in a text belongs to, "" for none."""
    words = problem.replace("'", " ").replace('"', " ").split()
    return next((name for word in words if (name := missing_package(word))), "")
