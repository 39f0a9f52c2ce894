"""`taskrpc alias`: lets a shell know `ros2`, so that a tutorial's lines can be pasted."""

from __future__ import annotations

import argparse

from taskrpc.cli.command import Exit

_POSIX = 'ros2() { taskrpc "$@"; }'
_DEFINITIONS = {
    "bash": _POSIX,
    "zsh": _POSIX,
    "fish": "function ros2; taskrpc $argv; end",
    "powershell": "function ros2 { taskrpc @args }",
}
_USES = {
    "bash": 'eval "$(taskrpc alias --shell bash)"',
    "zsh": 'eval "$(taskrpc alias --shell zsh)"',
    "fish": "taskrpc alias --shell fish | source",
    "powershell": "taskrpc alias --shell powershell | Out-String | Invoke-Expression",
}


def configure(parser: argparse.ArgumentParser) -> None:
    """Give the parser of `taskrpc alias` its arguments."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    lines = "\n".join(f"  {shell + ':':<12}{use}" for shell, use in _USES.items())
    parser.epilog = f"to use it, type one line, or put it into your shell's profile:\n{lines}"
    what = "the shell that is to know ros2"
    parser.add_argument("--shell", choices=sorted(_DEFINITIONS), required=True, help=what)
    parser.set_defaults(run=_alias)


def _alias(options: argparse.Namespace) -> Exit:
    print(_DEFINITIONS[options.shell])
    return Exit.DONE
