"""Prints one message instead of a traceback if a script does not catch an error of srvgen.

Errors of other kinds, such as a script's own TypeError, keep their traceback.
"""

from __future__ import annotations

import os
import sys

TYPE_CHECKING = False  # typing is slow to import
if TYPE_CHECKING:
    import threading
    from collections.abc import Callable, Iterator
    from types import TracebackType

_EXPLAINED = "_is_explained_by_srvgen"
"""The attribute of an error whose text `explain` has replaced."""
_ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
_OWN_PACKAGES = tuple(os.path.join(_ROOT, package, "") for package in ("srvgen", "taskrpc"))


def show_in_one_message(
    is_ours: Callable[[BaseException], bool] | None = None,
    exit_status: Callable[[BaseException], int] = lambda _: 1,
    hint: Callable[[BaseException], str] = lambda _: "",
) -> None:
    """Show errors for which `is_ours` is true, by default those of srvgen, without a traceback.

    A program with its own excepthook keeps it; `python -X dev` shows all tracebacks. A call with
    `is_ours` replaces one without; it shows Ctrl-C and errors of threads in one line, too. `hint`
    returns what else the user should know of an error.
    """
    hook = sys.excepthook
    replaceable = hook is sys.__excepthook__ or (
        is_ours is not None and isinstance(hook, _OneMessageHook)
    )
    if replaceable and not sys.flags.dev_mode:
        sys.excepthook = mine = _OneMessageHook(is_ours or _is_of_srvgen, exit_status, hint)
        if is_ours is not None:
            _show_those_of_threads(mine)


def _show_those_of_threads(hook: _OneMessageHook) -> None:
    import threading  # srvgen alone works without it

    present = threading.excepthook
    of_hook = isinstance(getattr(present, "__self__", None), _OneMessageHook)
    if present is threading.__excepthook__ or of_hook:
        threading.excepthook = hook.of_thread


def explain(error: BaseException | None) -> bool:
    """Replace the text of an error by one that names the mistake in the use of taskrpc.

    Such a mistake is a field that the message does not have, an argument that has another name in
    rclpy, or a file that hides a module of Python. Returns whether the text explains the error now.
    """
    if not isinstance(error, AttributeError | ImportError | TypeError):
        return False
    if hasattr(error, _EXPLAINED):
        return True
    text = _failed_import(error) if not isinstance(error, TypeError) else ""
    if not text and not isinstance(error, ImportError):
        from .misuse import explanation  # few programs end with an error

        text = explanation(error)
    if text:
        error.args = (text,)
        if isinstance(error, ImportError):
            error.msg = text
        setattr(error, _EXPLAINED, True)
    return bool(text)


def _failed_import(error: AttributeError | ImportError) -> str:
    """Explain why a module of Python, or rclpy, was not found; "" for other modules."""
    text, folder = str(error), sys.path[0] if sys.path else ""
    # What the program itself looks up in its own module is not there for another reason.
    is_of_library = os.path.dirname(_raising_file(error.__traceback__)) != folder
    for name in sys.stdlib_module_names & sys.modules.keys() if is_of_library else ():
        file = getattr(sys.modules[name], "__file__", None) or ""
        is_named = any(f"{word} '{name}" in text for word in ("from", "module", "named"))
        if is_named and file and os.path.dirname(file) == folder:
            return f"the file {file} hides Python's own module {name}; rename the file"
    if isinstance(error, ImportError) and error.name == "rclpy":
        return f"{text}; start the program with: taskrpc run {os.path.basename(sys.argv[0])}"
    return ""


def _raising_file(traceback: TracebackType | None) -> str:
    """The file in which an error was raised."""
    while traceback is not None and traceback.tb_next is not None:
        traceback = traceback.tb_next
    return "" if traceback is None else traceback.tb_frame.f_code.co_filename


class _OneMessageHook:
    """Replaces `sys.excepthook`. The SystemExit that it raises sets the exit status."""

    def __init__(
        self,
        is_ours: Callable[[BaseException], bool],
        exit_status: Callable[[BaseException], int],
        hint: Callable[[BaseException], str],
    ) -> None:
        self._is_ours = is_ours
        self._exit_status = exit_status
        self._hint = hint

    def __call__(
        self, kind: type[BaseException], error: BaseException, traceback: TracebackType | None
    ) -> None:
        if issubclass(kind, KeyboardInterrupt) and self._is_ours is not _is_of_srvgen:
            print("KeyboardInterrupt", file=sys.stderr)  # Python ends the process by SIGINT
            return
        if not self._told(error):
            keep_program_frames(error)
            sys.__excepthook__(kind, error, error.__traceback__)
        elif not hasattr(sys, "ps1") and not sys.flags.interactive:
            raise SystemExit(self._exit_status(next(_members(error))))

    def of_thread(self, args: threading.ExceptHookArgs) -> None:
        """Replace `threading.excepthook`: the error ends its thread, and not the program."""
        if args.exc_value is None or not self._told(args.exc_value):
            import threading

            threading.__excepthook__(args)

    def _told(self, error: BaseException) -> bool:
        """Print the message of an error; False if the program's author needs the traceback."""
        messages = messages_of(error, self._is_ours, _location, self._hint)
        if messages:
            print("\n".join(messages), file=sys.stderr)
        return bool(messages)


def keep_program_frames(error: BaseException) -> None:
    """Remove the lines of taskrpc from the traceback of an error and of those that caused it.

    A traceback without other lines stays, as all do with `python -X dev`.
    """
    from types import TracebackType

    seen: set[int] = set()
    each: BaseException | None = None if sys.flags.dev_mode else error
    while each is not None and id(each) not in seen:
        seen.add(id(each))
        kept = None
        for frame in reversed(list(_frames(each.__traceback__))):
            if not _is_hidden(frame.tb_frame.f_code.co_filename):
                kept = TracebackType(kept, frame.tb_frame, frame.tb_lasti, frame.tb_lineno)
        each.__traceback__ = kept or each.__traceback__
        each = each.__cause__ or each.__context__


def _frames(traceback: TracebackType | None) -> Iterator[TracebackType]:
    while traceback is not None:
        yield traceback
        traceback = traceback.tb_next


def _is_hidden(file: str) -> bool:
    threading = sys.modules.get("threading")
    return file.startswith(_OWN_PACKAGES) or (
        threading is not None and file == getattr(threading, "__file__", None)
    )


def messages_of(
    error: BaseException,
    is_ours: Callable[[BaseException], bool],
    location: Callable[[str, int], str],
    hint: Callable[[BaseException], str] = lambda _: "",
) -> list[str]:
    """Return the message that replaces the traceback of an error; several for a group of errors.

    Empty if the program's author needs the traceback, because `is_ours` is false for an error.
    `location` turns the file and the line in which the error was raised into the beginning of
    its message. `hint` returns a hint for an error that has none, or "".
    """
    errors = list(_members(error))
    explained = [explain(each) or is_ours(each) for each in errors]
    if not all(explained):
        return []
    found = []
    for each in errors:
        where = program_line(each.__traceback__) or program_line(error.__traceback__)
        message = f"{location(*where) if where else ''}{type(each).__name__}: {each}"
        notes = getattr(each, "__notes__", ()) or filter(None, [hint(each)])
        found.append("\n  hint: ".join([message, *notes]))
    return found


def _is_of_srvgen(error: BaseException) -> bool:
    from ._runtime import FieldError
    from .errors import DefinitionError

    return isinstance(error, DefinitionError | FieldError)


def _members(error: BaseException) -> Iterator[BaseException]:
    """The errors of a group, such as an `asyncio.TaskGroup` raises; any other error is its own."""
    if isinstance(error, BaseExceptionGroup):
        for each in error.exceptions:
            yield from _members(each)
    else:
        yield error


def program_line(traceback: TracebackType | None) -> tuple[str, int] | None:
    """Return the last line of a traceback in the program itself, outside of all libraries."""
    import sysconfig

    folders = [sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")]
    libraries = *_OWN_PACKAGES, *(os.path.join(folder, "") for folder in folders)
    where = None
    while traceback is not None:
        file = traceback.tb_frame.f_code.co_filename
        if not file.startswith(("<", *libraries)):
            where = file, traceback.tb_lineno
        traceback = traceback.tb_next
    return where


def _location(file: str, line: int) -> str:
    """The beginning of a message: `file.py:12: `."""
    try:
        folder = os.path.join(os.getcwd(), "")
    except OSError:  # it was removed
        folder = ""
    return f"{file.removeprefix(folder)}:{line}: "
