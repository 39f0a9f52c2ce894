"""`taskrpc shell`: defines `ros2` in a shell, so that users can paste lines of ROS tutorials."""

from __future__ import annotations

import argparse

from taskrpc.cli.shared.command import Exit

_ROSDEP = "#All required rosdeps installed successfully (taskrpc installs nothing)"
_ALIAS = """alias ros2=taskrpc
function ros2 { taskrpc "$@"; }
"""
"""The function works in the line that defines it. The alias is for background jobs: `ros2 run … &`
then starts taskrpc itself and not a shell that waits for it, so that `kill $!` ends the node."""

_POSIX = f"""command -v colcon >/dev/null || colcon() {{ taskrpc colcon "$@"; }}
command -v rosdep >/dev/null || rosdep() {{ echo "{_ROSDEP}"; }}
"""
_FISH = f"""function ros2; taskrpc $argv; end
if not type -q colcon; function colcon; taskrpc colcon $argv; end; end
if not type -q rosdep; function rosdep; echo "{_ROSDEP}"; end; end
"""
_POWERSHELL = f"""function ros2 {{ taskrpc @args }}
function _is_missing {{ -not (Get-Command $args[0] -ErrorAction SilentlyContinue) }}
if (_is_missing colcon) {{ function colcon {{ taskrpc colcon @args }} }}
if (_is_missing rosdep) {{ function rosdep {{ "{_ROSDEP}" }} }}
"""
_DEFINITIONS = {
    "bash": f"shopt -s expand_aliases\n{_ALIAS}{_POSIX}",
    "zsh": f"{_ALIAS}{_POSIX}",
    "sh": f'ros2() {{ taskrpc "$@"; }}\n{_POSIX}',
    "fish": _FISH,
    "powershell": _POWERSHELL,
}
_DESCRIPTION = """\
Print definitions for a shell: `ros2` then means `taskrpc`. If colcon and rosdep are missing, the
shell gets substitutes for them. In bash, zsh and fish the TAB key completes commands, options and
names; this needs `pip install argcomplete`."""
_USES = {
    "bash": 'eval "$(taskrpc shell bash)"',
    "zsh": 'eval "$(taskrpc shell zsh)"',
    "fish": "taskrpc shell fish | source",
    "powershell": "taskrpc shell powershell | Out-String | Invoke-Expression",
}


_COMPLETED = ["taskrpc", "ros2", "taskrpc-call", "taskrpc-server", "srvgen"]
_WITHOUT_COMPLETION = "# completion with TAB needs argcomplete: pip install argcomplete\n"


def configure(parser: argparse.ArgumentParser) -> None:
    """Give the parser of `taskrpc shell` its arguments."""
    parser.add_argument("shell", choices=sorted(_DEFINITIONS), help="The shell that you use")
    parser.description = _DESCRIPTION
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    lines = "\n".join(f"  {shell + ':':<12}{use}" for shell, use in _USES.items())
    parser.epilog = f"Type this line, or add it to the profile of your shell:\n{lines}"
    parser.set_defaults(run=_print_definitions)


def _print_definitions(options: argparse.Namespace) -> Exit:
    print(_DEFINITIONS[options.shell] + _completion(options.shell), end="")
    return Exit.DONE


def _completion(shell: str) -> str:
    """The code that lets a shell complete the commands."""
    if shell not in ("bash", "fish", "zsh"):
        return ""
    try:
        from argcomplete.shell_integration import shellcode
    except ImportError:
        return _WITHOUT_COMPLETION
    code = shellcode(_COMPLETED, shell=shell)
    # A zsh whose profile does not run compinit has no `compdef`.
    return f"if (( ${{+functions[compdef]}} )); then\n{code}\nfi\n" if shell == "zsh" else code
