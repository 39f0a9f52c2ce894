"""The contract of imports: the core, the districts around it, and their order.

`docs/explanation/contract.md` explains the rules, and `contract.toml` has them as tables. A module
is checked without an entry there. A folder or module at the top of `taskrpc/` needs an entry.
"""

from __future__ import annotations

import re
import sys

import pytest

from tests.source_tree import (
    CONTRACT,
    ROOT,
    Import,
    homes,
    imports,
    module_of,
    modules,
    source_files,
)

DISTRICTS: list[str] = CONTRACT["districts"]
PLACES: dict[str, str] = {
    name: district for district, names in CONTRACT["top"].items() for name in names
}
"""The district of each folder and module at the top of `taskrpc/`."""
EVERYWHERE = {"msgspec", "yaml", "srvgen", "taskrpc"}
SPI = "taskrpc.spi"


def district_of(module: str) -> str:
    """Return the district of a module, "" if its folder or file is new at the top."""
    package, _, inner = module.partition(".")
    if package == "srvgen":
        return package
    return PLACES.get(inner.partition(".")[0] or "__init__", "")


def violations(path: str, text: str | bytes) -> set[str]:
    """Return what a module with this path and text imports against the contract."""
    importer = module_of(path)
    found: set[str] = set()
    if not district_of(importer):
        found.add(f"{path}: is new at the top of taskrpc/; choose a district")
    for each in imports(path, text):
        package = each.module.partition(".")[0]
        if package in ("srvgen", "taskrpc"):
            problem = problem_inside(importer, each)
        else:
            problem = problem_outside(path, package)
        if problem:
            found.add(f"{importer} imports {'.'.join(filter(None, each))}: {problem}")
    return found


def problem_inside(importer: str, imported: Import) -> str:
    """Return what is wrong with an import of a module of srvgen or taskrpc, "" if nothing is."""
    own, other = district_of(importer), district_of(imported.module)
    if importer == "taskrpc" or not own:
        return ""  # the root names what users import, of all districts
    if imported.module == "taskrpc":
        other = district_of(homes().get(imported.name, "taskrpc"))
        if DISTRICTS.index(own) <= DISTRICTS.index("core"):
            return "the core imports the modules themselves"
    elif other == own:
        return layer_problem(importer, imported.module)
    elif other == "core" and not is_public(imported.module):
        return f"use a public name, or add the name to {SPI}"
    if not other:
        return "no district has it"
    if DISTRICTS.index(other) > DISTRICTS.index(own):
        return f"{own} is before {other} in the order of the districts"
    return ""


def is_public(module: str) -> bool:
    """Whether districts may import names of this module of the core."""
    inner = module.partition(".")[2]
    return inner in CONTRACT["public"]


def layer_problem(importer: str, imported: str) -> str:
    """Return whether an import inside a package goes up its layers, "" if it does not."""
    for table in CONTRACT["layers"]:
        own, other = (layer_in(table, each) for each in (importer, imported))
        if None in (own, other) or district_of(table["of"]) != district_of(importer):
            continue
        if -1 in (own, other):
            name = importer if own == -1 else imported
            return f"{name} is in no layer of {table['of']}"
        if own < other or (own == other and not same_part(table, importer, imported)):
            return f"the layers of {table['of']} do not allow it"
    return ""


def part_in(table: dict[str, object], module: str) -> str | None:
    """Return the part of a layered package that a module belongs to, None if to none."""
    for container in sorted(table["containers"], key=len, reverse=True):
        if module.startswith(f"{container}."):
            return f"{container}.{module[len(container) + 1 :].partition('.')[0]}"
    return None


def layer_in(table: dict[str, object], module: str) -> int | None:
    """Return the number of a module's layer from the bottom; -1 if its part is not listed."""
    part = part_in(table, module)
    if part is None or part in table["containers"]:
        return None
    for number, layer in enumerate(reversed(table["order"])):
        if part in [f"{table['of']}.{each}" for each in layer.split()]:
            return number
    return -1


def same_part(table: dict[str, object], importer: str, imported: str) -> bool:
    return part_in(table, importer) == part_in(table, imported)


def problem_outside(path: str, package: str) -> str:
    """Return what is wrong with an import of another project's module, "" if nothing is."""
    if is_pure(path) and package in CONTRACT["outside"]:
        return "pure modules use no files, sockets, clock, chance or threads"
    if package in EVERYWHERE or package in sys.stdlib_module_names:
        return ""
    allowed = CONTRACT["packages"].get(package)
    if allowed is None and is_of_ros(package):
        allowed = CONTRACT["packages_of_ros"]
    if allowed is None:
        return "no module may import this package"
    return "" if path.startswith(tuple(allowed)) else f"only {', '.join(allowed)} may import it"


def is_pure(path: str) -> bool:
    return path.startswith(tuple(CONTRACT["pure"])) and path not in CONTRACT["shells"]


def is_of_ros(package: str) -> bool:
    pattern = r"\w+_(msgs|srvs|interfaces|py|ros|python)|rclpy|launch|turtlesim"
    ours = ROOT / "taskrpc" / "ros" / "packages" / package
    return bool(re.fullmatch(pattern, package)) or ours.is_dir()


def test_each_module_keeps_the_contract():
    found = {
        problem
        for path in source_files()
        for problem in violations(path, (ROOT / path).read_bytes())
    }
    assert sorted(found) == []


def test_the_tables_name_what_exists():
    tops = {each.split(".")[1] for each in modules() if each.startswith("taskrpc.")}
    assert sorted(PLACES) == sorted({*tops, "__init__"})
    named = [*CONTRACT["pure"], *CONTRACT["shells"], *CONTRACT["templates"]]
    named += [path for paths in CONTRACT["packages"].values() for path in paths]
    assert [path for path in named if not (ROOT / path).exists()] == []


def test_little_lies_at_the_top():
    top = {each.name for each in (ROOT / "taskrpc").iterdir() if each.suffix != ".typed"}
    folders = {each for each in top if (ROOT / "taskrpc" / each).is_dir()} - {"__pycache__"}
    assert len(folders) <= 12
    assert len(top - folders - {"__pycache__"}) <= 15


@pytest.mark.parametrize(
    ("path", "text", "problem"),
    [
        ("taskrpc/ros/packages/rclpy/node.py", "import mcap", "may import it"),
        ("taskrpc/ros/packages/rclpy/node.py", "import psycopg", "may import it"),
        ("taskrpc/core/new.py", "def f():\n    from aiohttp import web", "may import it"),
        ("taskrpc/cli/new.py", "import requests", "no module may import this package"),
        ("taskrpc/node.py", "import std_msgs.msg", "may import it"),
        ("taskrpc/core/wire/new.py", "import socket", "pure modules"),
        ("taskrpc/robot/tasks/queue/new.py", "from time import monotonic", "pure modules"),
        ("srvgen/cdr/new.py", "import os.path, msgspec, struct", "pure modules"),
        ("taskrpc/new.py", "", "choose a district"),
        ("taskrpc/new/start.py", "", "choose a district"),
        ("taskrpc/node.py", "def f():\n    import taskrpc.robot.tasks.server", "order of the"),
        ("taskrpc/core/wire/session.py", "from taskrpc import TaskServer", "modules themselves"),
        ("taskrpc/core/new.py", "import taskrpc.errors", "in no layer of taskrpc"),
        ("taskrpc/core/wire/new.py", "import taskrpc.core.transport.endpoint", "the layers of"),
        ("taskrpc/core/transport/codec.py", "import taskrpc.core.transport.endpoint", "layers of"),
        ("taskrpc/robot/fleet/new.py", "from taskrpc.core.wire.messages import Listing", SPI),
        ("taskrpc/robot/new.py", "from taskrpc.cli.main import main", "order of the districts"),
        ("taskrpc/robot/new.py", "from taskrpc import Metrics", "order of the districts"),
        ("srvgen/new.py", "import taskrpc.errors", "order of the districts"),
    ],
)
def test_a_violation_is_found(path, text, problem):
    [found] = violations(path, text)
    assert problem in found


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("taskrpc/robot/new.py", "import asyncio, yaml\nfrom taskrpc.errors import TaskRpcError"),
        ("taskrpc/cli/new.py", "from taskrpc.spi import RegistryEntry\nfrom taskrpc import Node"),
        ("taskrpc/observe/recording/mcap_file.py", "import mcap"),
        ("taskrpc/ros/new.py", "import std_msgs.msg"),
        ("taskrpc/core/transport/endpoint.py", "import taskrpc.core.transport.codec"),
    ],
)
def test_other_imports_are_allowed(path, text):
    assert violations(path, text) == set()


def test_the_module_that_generated_packages_contain_needs_only_msgspec():
    path = "srvgen/_runtime.py"
    packages = {each.module.partition(".")[0] for each in imports(path, (ROOT / path).read_bytes())}
    assert packages - set(sys.stdlib_module_names) == {"msgspec"}
