"""`taskrpc alias`: lets a shell know `ros2`, so that a tutorial's lines can be pasted."""

from __future__ import annotations

import argparse

from taskrpc.cli.shared.command import Exit

_ROSDEP = "#All required rosdeps installed successfully: taskrpc brings what it knows"
_ALIAS = """alias ros2=taskrpc
function ros2 { taskrpc "$@"; }
"""
"""The function works in the line that defines it; the alias puts taskrpc itself, and not a shell
that waits for it, in the background, so that `kill $!` ends a node."""

_POSIX = f"""command -v colcon >/dev/null || colcon() {{ taskrpc colcon "$@"; }}
command -v rosdep >/dev/null || rosdep() {{ echo "{_ROSDEP}"; }}
"""
_BASH = """_taskrpc() {
  local IFS=$'\\n'
  COMPREPLY=($(taskrpc alias --complete "${COMP_WORDS[@]:1:COMP_CWORD}" 2>/dev/null))
}
complete -o default -F _taskrpc ros2 taskrpc
"""
_ZSH = """_taskrpc() {
  compadd -- ${(f)"$(taskrpc alias --complete "${(@)words[2,CURRENT]}" 2>/dev/null)"}
}
(( ! ${+functions[compdef]} )) || compdef _taskrpc ros2 taskrpc
"""
_FISH = f"""function ros2; taskrpc $argv; end
if not type -q colcon; function colcon; taskrpc colcon $argv; end; end
if not type -q rosdep; function rosdep; echo "{_ROSDEP}"; end; end
function _taskrpc; taskrpc alias --complete (commandline -opc)[2..] (commandline -ct); end
complete -c ros2 -f -a '(_taskrpc)'
complete -c taskrpc -f -a '(_taskrpc)'
"""
_POWERSHELL = f"""function ros2 {{ taskrpc @args }}
function _is_missing {{ -not (Get-Command $args[0] -ErrorAction SilentlyContinue) }}
if (_is_missing colcon) {{ function colcon {{ taskrpc colcon @args }} }}
if (_is_missing rosdep) {{ function rosdep {{ "{_ROSDEP}" }} }}
"""
_DEFINITIONS = {
    "bash": f"shopt -s expand_aliases\n{_ALIAS}{_POSIX}{_BASH}",
    "zsh": f"{_ALIAS}{_POSIX}{_ZSH}",
    "sh": f'ros2() {{ taskrpc "$@"; }}\n{_POSIX}',
    "fish": _FISH,
    "powershell": _POWERSHELL,
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
    what = "the shell that is to know ros2 (colcon and rosdep too, where they are not)"
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("--shell", choices=sorted(_DEFINITIONS), help=what)
    which.add_argument("--complete", nargs=argparse.REMAINDER, help=argparse.SUPPRESS)
    parser.set_defaults(run=_alias)


def _alias(options: argparse.Namespace) -> Exit:
    if options.complete is not None:
        from taskrpc.cli.shared.completing import candidates

        print("\n".join(candidates(options.complete)))
    else:
        print(_DEFINITIONS[options.shell], end="")
    return Exit.DONE
