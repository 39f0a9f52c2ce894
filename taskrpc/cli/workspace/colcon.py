"""`taskrpc colcon`: the colcon commands of tutorials; packages run here without a build."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from taskrpc.cli.shared.command import Exit, NotFound, hinted
from taskrpc.cli.shared.parsing import add_command, add_group, add_ignored

_SHELLS = {".bash": "bash", ".zsh": "zsh", ".sh": "sh"}
_NOTE = "taskrpc: nothing was built: packages run from their sources here"


def configure(parser: argparse.ArgumentParser) -> None:
    """Give a parser the colcon commands that tutorials use."""
    commands = add_group(parser)
    purpose = "Check the definitions of a workspace's packages; nothing needs to be built"
    build = add_command(commands, "build", purpose)
    what = "Only these packages"
    for option in ("--packages-select", "--packages-up-to"):
        build.add_argument(option, metavar="NAME", nargs="+", default=[], dest="names", help=what)
    for option in ("--symlink-install", "--merge-install", "--continue-on-error"):
        add_ignored(build, option, action="store_true")
    for option in ("--cmake-args", "--event-handlers", "--parallel-workers"):
        add_ignored(build, option, metavar="ARG", nargs="*")
    build.set_defaults(run=_build)
    listing = add_command(commands, "list", "List the packages of the workspace here")
    listing.set_defaults(run=_list)


def _list(_: argparse.Namespace) -> int:
    for name, folder in sorted(_packages().items()):
        where = folder.relative_to(Path.cwd()) if folder.is_relative_to(Path.cwd()) else folder
        print(f"{name}\t{where.as_posix()}")
    return Exit.DONE


def _build(options: argparse.Namespace) -> int:
    found = _packages()
    for name in options.names:
        if name not in found:
            from srvgen.definitions.names import did_you_mean

            hint = did_you_mean(name, sorted(found))
            raise hinted(NotFound(f"no package '{name}' in the workspace here"), hint)
    began = time.monotonic()
    chosen = sorted(options.names or found)
    failed = [name for name in chosen if not _build_one(name)]
    _make_setup(Path.cwd() / "install")
    done = len(chosen) - len(failed)
    seconds = time.monotonic() - began
    print(f"\nSummary: {done} package{'s'[: done != 1]} finished [{seconds:.2f}s]")
    if failed:
        print(f"  {len(failed)} package{'s'[: len(failed) != 1]} failed: {' '.join(failed)}")
    print(_NOTE, file=sys.stderr)
    _note_compiled({name: found[name] for name in chosen})
    return Exit.ERROR if failed else Exit.DONE


def _note_compiled(packages: dict[str, Path]) -> None:
    """Say which programs cannot run here, and why."""
    from taskrpc.ros.executables import compiled_programs
    from taskrpc.ros.missing import WHAT_RUNS

    programs = {name: ", ".join(sorted(compiled_programs(packages[name]))) for name in packages}
    if any(programs.values()):
        shown = "; ".join(f"{each} of {name}" for name, each in programs.items() if each)
        print(f"taskrpc: not built: {shown}: {WHAT_RUNS}", file=sys.stderr)


def _build_one(name: str) -> bool:
    """Check a package and print the lines that colcon prints; returns whether it is valid."""
    print(f"Starting >>> {name}", flush=True)
    began = time.monotonic()
    problems = list(_problems(name))
    end = "Failed  " if problems else "Finished"
    if problems:
        print(f"--- stderr: {name}", *problems, "---", sep="\n", file=sys.stderr)
    print(f"{end} <<< {name} [{time.monotonic() - began:.2f}s]", flush=True)
    return not problems


def _problems(package: str) -> list[str]:
    """Return the errors in a package's definitions."""
    import srvgen
    from taskrpc.cli.shared import definitions

    search = definitions.search()
    if package not in search.packages():
        return []
    problems = []
    for interface in search.interfaces(package):
        try:
            definitions.load(interface)
        except srvgen.DefinitionError as error:
            problems.append(str(error))
    return problems


def _packages() -> dict[str, Path]:
    from taskrpc.ros import workspace

    return workspace.packages(Path.cwd())


def _make_setup(folder: Path) -> None:
    """Write the files that tutorials source after a build; they define `ros2` in the shell."""
    if (folder / ".colcon_install_layout").exists():
        return  # a real colcon made this folder
    folder.mkdir(exist_ok=True)
    (folder / "COLCON_IGNORE").touch()
    texts = {
        f"setup{suffix}": f'eval "$(taskrpc shell {shell})"\n' for suffix, shell in _SHELLS.items()
    }
    powershell = "taskrpc shell powershell | Out-String | Invoke-Expression\n"
    texts |= {"setup.ps1": powershell, "setup.bat": "@doskey ros2=taskrpc $*\n"}
    for name, text in texts.items():
        for each in (name, f"local_{name}"):
            (folder / each).write_text(text, encoding="utf-8")
