"""What IPython does for a notebook: pictures, errors, cells and magics; only this imports IPython.

Outside of IPython, pictures are printed as text, and everything else does nothing.
"""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from srvgen import DefinitionError, FieldError
from taskrpc.course.notebook.errors import lines_of
from taskrpc.errors import TaskRpcError

_SHORT = (
    *(TaskRpcError, DefinitionError, FieldError, ExceptionGroup),
    *(AttributeError, RuntimeError, TypeError, ValueError),
    *(KeyboardInterrupt, asyncio.CancelledError),
    SyntaxError,  # IPython would show the frames of `%%lab`
)
"""The errors of which a cell may show one line; the others go to IPython at once."""


def shell() -> Any:
    """Return the running shell of IPython, None outside of it."""
    if "IPython" not in sys.modules:
        return None
    from IPython import get_ipython

    return get_ipython()


def is_notebook() -> bool:
    """Whether a kernel runs this program, so that pictures can change after they were shown."""
    return hasattr(shell(), "kernel")


class Picture:
    """A picture below a cell; `show` draws it, and draws it again later."""

    def __init__(self) -> None:
        self._handle: Any = None

    def show(self, html: str, text: str) -> None:
        """Draw it; frontends without HTML show the text."""
        bundle = {"text/html": html, "text/plain": text}
        if not is_notebook():
            print(text)
        elif self._handle is None:
            from IPython.display import display

            self._handle = display(bundle, raw=True, display_id=True)
        else:
            self._handle.update(bundle, raw=True)


def install(
    cell_begins: Callable[[str], None],
    magics: Mapping[str, Callable[[str, str], object]],
    errors: Iterable[type[Exception]],
) -> None:
    """Connect a notebook with IPython.

    Args:
        cell_begins: called with the id of each cell before it runs, "" if it has none.
        magics: the cell magics by their names.
        errors: rclpy's errors, of which a cell may show one line too.
    """
    found = shell()
    if found is None:
        return
    found.events.register(
        "pre_run_cell", lambda info: cell_begins(getattr(info, "cell_id", None) or "")
    )
    found.set_custom_exc((*_SHORT, *errors), _show_error)
    for name, magic in magics.items():
        found.register_magic_function(magic, "cell", name)


def run_in_cell(text: str, path: Path) -> None:
    """Run a file's text in the notebook's namespace, without its `if __name__ == "__main__"`."""
    found = shell()
    namespace = {} if found is None else found.user_ns
    before = namespace.get("__name__")
    namespace["__name__"] = path.stem
    try:
        exec(compile(text, str(path), "exec"), namespace)
    except Exception as error:
        if found is not None and error.__traceback__ is not None:
            # The traceback begins in the file, not in the magic that runs it.
            inner = type(error), error, error.__traceback__.tb_next
            _render(error, lambda: found.InteractiveTB.structured_traceback(*inner))
        raise
    finally:
        namespace["__name__"] = before


def _show_error(
    found: Any,
    kind: type[BaseException],
    error: BaseException,
    traceback: Any,
    tb_offset: Any = None,
) -> None:
    lines = lines_of(error, _location)
    if lines:
        _render(error, lambda: lines)
    found.showtraceback((kind, error, traceback), tb_offset=tb_offset)


def _render(error: BaseException, lines: Callable[[], list[str]]) -> None:
    """Let IPython show other lines for an error: it asks each error for this method."""
    vars(error)["_render_traceback_"] = lines


def cell_name(file: str) -> str:
    """Return a file as a message names it: `Cell In[3]`, or its relative path."""
    found = shell()
    label = None if found is None else found.compile.format_code_name(file)
    if label is not None:
        return " ".join(label)
    return file.removeprefix(os.path.join(os.getcwd(), ""))


def _location(file: str, line: int) -> str:
    """The beginning of a message: `Cell In[3], line 2: `."""
    return f"{cell_name(file)}, line {line}: "
