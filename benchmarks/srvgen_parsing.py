"""How fast definitions are parsed and loaded, beside rosidl's own parser and rosbags.

    pip install rosbags               # each other parser is left out where it is missing
    python benchmarks/srvgen_parsing.py [--definitions FOLDER] [--rounds 5] [--json results.json]

rosidl's own parser is in no package index, but in ROS 2 (source its setup file first) and in
Debian's and Ubuntu's package python3-rosidl: install it, or unpack it with `dpkg -x`, and put its
folder `dist-packages` on PYTHONPATH. Only `rosidl_adapter.parser` is used, which needs nothing
else.

Parsing: all contenders are handed the same texts, from memory, take turns in every round, and the
least of the rounds counts. A section is a message, a request, a response and so on: rosbags, which
knows messages only, is handed each section as a message of its own. Only files count that all of
them accept. Our cache of types is emptied before every round.

Loading: each figure is the least of several fresh interpreters, in which bytecode of the libraries
is at hand, as it is once they are installed. `import srvgen` includes msgspec; `load` is
the first one of the program and reads, parses, renders and compiles the type with all that it
needs; `again` looks whether the files are still the same; `generated` is the import of the modules
that `srvgen generate` makes of the same type, after msgspec.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from srvgen.classes.generate import generate
from srvgen.definitions.field_types import parse_type
from srvgen.files.reading import KINDS, parse_definition
from srvgen.files.search import BUNDLED, Search

ROOT = Path(__file__).resolve().parents[1]
LOADED = (
    "example_interfaces/srv/AddTwoInts",
    "std_srvs/srv/Trigger",
    "rcl_interfaces/srv/SetParameters",
    "nav_msgs/srv/GetPlan",
    "example_interfaces/action/Fibonacci",
)
STARTS = 9
"""Interpreters that are started for each figure of loading."""
LOAD = """
import sys, time
clock = time.perf_counter
begin = clock()
import srvgen
load = srvgen.load
imported = clock()
load(sys.argv[1])
loaded = clock()
for _ in range(100):
    load(sys.argv[1])
print(imported - begin, loaded - imported, (clock() - loaded) / 100)
"""
IMPORT = """
import importlib, sys, time
import msgspec
package, kind, name = sys.argv[1].split("/")
begin = time.perf_counter()
getattr(importlib.import_module(f"{package}.{kind}"), name)
print(time.perf_counter() - begin)
"""


@dataclass(frozen=True)
class File:
    """One definition: its text, and the name that its place gives it."""

    package: str
    kind: Any
    name: str
    text: str

    @property
    def sections(self) -> list[str]:
        """The text cut at its separators."""
        cut: list[list[str]] = [[]]
        for line in self.text.splitlines():
            if line == "---" and self.kind != "msg":
                cut.append([])
            else:
                cut[-1].append(line)
        return ["\n".join(lines) for lines in cut]


@dataclass
class Contender:
    """One parser as a function of a file, and the seconds that it took for all of them."""

    name: str
    parse: Callable[[File], object]
    times: list[float] = field(default_factory=list)

    def accepts(self, file: File) -> bool:
        try:
            self.parse(file)
        except Exception:  # each parser has its own
            return False
        return True

    def run(self, files: Sequence[File]) -> None:
        parse_type.cache_clear()
        begin = time.perf_counter()
        for file in files:
            self.parse(file)
        self.times.append(time.perf_counter() - begin)


def ours() -> Contender:
    return Contender(
        "srvgen", lambda one: parse_definition(one.text, one.package, one.kind, one.name)
    )


def official() -> Contender:
    from rosidl_adapter import parser

    parsers = {
        "msg": parser.parse_message_string,
        "srv": parser.parse_service_string,
        "action": parser.parse_action_string,
    }
    return Contender(
        "rosidl_adapter", lambda one: parsers[one.kind](one.package, one.name, one.text)
    )


def rosbags() -> Contender:
    from rosbags.typesys import get_types_from_msg

    def parse(file: File) -> object:
        name = f"{file.package}/msg/{file.name}"
        return [get_types_from_msg(text, name) for text in file.sections]

    return Contender("rosbags", parse)


def contenders() -> Iterator[Contender]:
    for make in (ours, official, rosbags):
        try:
            yield make()
        except ImportError as error:
            print(f"left out: {make.__name__} ({error})", file=sys.stderr)


def read_files(folder: Path) -> list[File]:
    """Every definition below a folder that is UTF-8."""
    found = []
    for kind in KINDS:
        for path in sorted(folder.rglob(f"{kind}/*.{kind}")):
            try:
                text = path.read_bytes().decode()
            except UnicodeDecodeError:
                continue
            found.append(File(path.parents[1].name, kind, path.stem, text))
    return found


def measure_parsing(all_: list[Contender], folder: Path, rounds: int) -> dict[str, Any]:
    files = read_files(folder)
    accepted = [file for file in files if all(one.accepts(file) for one in all_)]
    for _ in range(rounds):
        for one in all_:
            one.run(accepted)
    sections = sum(len(file.sections) for file in accepted)
    return {
        "files": len(files),
        "accepted by all": len(accepted),
        "sections": sections,
        "sections a second": {one.name: sections / min(one.times) for one in all_},
    }


def measure_loading() -> dict[str, dict[str, float]]:
    """Milliseconds of each step, by type."""
    with tempfile.TemporaryDirectory() as folder:
        for path, text in _generated().items():
            target = Path(folder, "generated", path)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(text, encoding="utf-8")
        return {name: _loading(name, Path(folder)) for name in LOADED}


def _generated() -> dict[str, str]:
    search = Search([BUNDLED])
    packages: dict[str, list[Any]] = {}
    for name in LOADED:
        packages.setdefault(name.split("/")[0], []).append(search.load(name))
    return generate(packages, search)


def _loading(name: str, folder: Path) -> dict[str, float]:
    steps = ("import srvgen", "load", "again")
    found = dict(zip(steps, _least(LOAD, name, ROOT, folder), strict=True))
    return found | {"generated": _least(IMPORT, name, folder / "generated", folder)[0]}


def _least(code: str, name: str, path: Path, folder: Path) -> list[float]:
    environment = dict(os.environ)
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    environment |= {"PYTHONPATH": str(path), "PYTHONPYCACHEPREFIX": str(folder / "bytecode")}
    runs = [
        subprocess.run(
            [sys.executable, "-c", code, name],
            capture_output=True,
            text=True,
            check=True,
            cwd=folder,
            env=environment,
        ).stdout.split()
        for _ in range(STARTS + 1)
    ]
    # The first run may have written bytecode.
    return [min(map(float, column)) * 1e3 for column in zip(*runs[1:], strict=True)]


def print_parsing(result: dict[str, Any]) -> None:
    print(
        f"{result['sections']} sections of the {result['accepted by all']} files that all accept, "
        f"of {result['files']}"
    )
    speeds = result["sections a second"]
    print("parser".rjust(16), "sections/s".rjust(12), "srvgen / it".rjust(14))
    for name, speed in speeds.items():
        print(f"{name:>16} {speed:>12,.0f} {speeds['srvgen'] / speed:>14.2f}")


def print_loading(result: dict[str, dict[str, float]]) -> None:
    steps = next(iter(result.values()))
    print("\nmilliseconds".ljust(38) + "".join(step.rjust(15) for step in steps))
    for name, times in result.items():
        print(name.ljust(37) + "".join(f"{ms:15.3f}" for ms in times.values()))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--definitions",
        type=Path,
        default=BUNDLED,
        help="folder with .msg, .srv and .action files to parse (default: the bundled packages)",
    )
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", type=Path, help="write the numbers there, too")
    options = parser.parse_args()
    parsing = measure_parsing(list(contenders()), options.definitions, options.rounds)
    print_parsing(parsing)
    loading = measure_loading()
    print_loading(loading)
    if options.json:
        text = json.dumps({"parsing": parsing, "loading in ms": loading}, indent=2)
        options.json.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
