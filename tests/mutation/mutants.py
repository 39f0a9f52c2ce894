"""`make mutants`: which small changes of the critical modules do the tests not notice?

Needs the extra `mutants`. Give paths of modules to test only those.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
FOLDER = ROOT / ".mutants"
"""Where the mutants are made; nothing in it is needed afterwards."""
MODULES = HERE / "modules.toml"
REASONS = HERE / "reasons.toml"

SETTINGS = """
[tool.mutmut]
source_paths = ["srvgen", "taskrpc"]
also_copy = ["examples"]
only_mutate = [{module}]
pytest_add_cli_args_test_selection = {tests}
pytest_add_cli_args = ["-n0", "-p", "no:cacheprovider", "-W", "ignore"]
process_isolation = "forkserver"
on_dependency_change = "ignore"
use_git_change_detection = false
timeout_multiplier = 8.0
timeout_constant = 2.0
"""


class MutmutFailed(Exception):
    """A module could not be tested, for instance because a test fails without any mutant."""


def main() -> int:
    """Test the modules one after another, and tell what survived without a reason."""
    arguments = parsed()
    modules = tomllib.loads(MODULES.read_text())
    reasons = tomllib.loads(REASONS.read_text())
    unknown = sorted(set(arguments.modules) - set(modules))
    if unknown:
        print(f"not in {MODULES.relative_to(ROOT)}: {', '.join(unknown)}", file=sys.stderr)
        return 2
    chosen = arguments.modules or modules
    found, failed = {}, 0
    for module in chosen:
        began = time.monotonic()
        try:
            found[module] = tested(module, modules[module], arguments)
        except MutmutFailed as error:
            failed += 1
            print(f"{module}: {error}", flush=True)
            continue
        row(module, found[module], reasons.get(module, {}), time.monotonic() - began)
        if arguments.json:
            Path(arguments.json).write_text(json.dumps(found, indent=1))
    unexplained = 0
    for module, report in found.items():
        known = reasons.get(module, {})
        new = [each for each in survivors(report) if each not in known]
        unexplained += len(new)
        for each in new:
            print(f"\n{module}\n  {each}")
    print(f"\n{unexplained} mutants survived without a reason in {REASONS.relative_to(ROOT)}")
    return 1 if unexplained or failed else 0


def parsed() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(prog="make mutants", description=__doc__)
    parser.add_argument("modules", nargs="*", metavar="MODULE", help="such as taskrpc/retry.py")
    parser.add_argument("--sample", type=int, default=0, help="mutants a module, 0 for all (0)")
    parser.add_argument("--seed", type=int, default=1, help="what the sample is drawn with (1)")
    parser.add_argument("--children", type=int, default=os.cpu_count() or 1, help="processes")
    parser.add_argument("--again", metavar="FILE", help="only what survived in these results")
    parser.add_argument("--json", metavar="FILE", help="write the results to this file, too")
    return parser.parse_args()


def tested(module: str, tests: list[str], arguments: argparse.Namespace) -> dict[str, object]:
    """Have mutmut test one module, in a folder with links to all that the tests need."""
    shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir()
    for name in ("srvgen", "taskrpc", "tests", "examples"):
        (FOLDER / name).symlink_to(ROOT / name)
    selected = [f"tests/{test}" for test in tests]
    settings = SETTINGS.format(module=json.dumps(module), tests=json.dumps(selected))
    (FOLDER / "pyproject.toml").write_text((ROOT / "pyproject.toml").read_text() + settings)
    report = FOLDER / "report.json"
    numbers = [str(arguments.sample), str(arguments.seed), str(arguments.children)]
    command = [sys.executable, str(HERE / "mutate.py"), module, *numbers, str(report)]
    if arguments.again:
        command.append(str(Path(arguments.again).resolve()))
    with (FOLDER / "log").open("w") as log:
        done = subprocess.run(command, cwd=FOLDER, stdout=log, stderr=subprocess.STDOUT)
    if done.returncode or not report.exists():
        said = [line.split("\r")[-1] for line in (FOLDER / "log").read_text().splitlines()]
        raise MutmutFailed(
            "mutmut failed; look first whether the tests pass: pytest -n0 "
            + " ".join(selected)
            + "".join(f"\n    {line}" for line in said[-5:] if line.strip())
        )
    found: dict[str, object] = json.loads(report.read_text())
    return found


def survivors(report: dict[str, object]) -> list[str]:
    """What the tests did not notice, each as `function: before → after`."""
    results = report["results"]
    assert isinstance(results, dict)
    return [summary(name, each["diff"]) for name, each in results.items() if each["diff"]]


def summary(name: str, diff: str) -> str:
    """A mutant in one line that stays the same when other lines of its module change."""
    function = re.sub(r"__mutmut_\d+$", "", name.rpartition(".")[2])
    function = function.removeprefix("x_").removeprefix("xǁ").replace("ǁ", ".")
    lines = diff.splitlines()[2:]
    before = " ".join(line[1:].strip() for line in lines if line.startswith("-"))
    after = " ".join(line[1:].strip() for line in lines if line.startswith("+"))
    return f"{function}: {before} → {after}"


def row(module: str, report: dict[str, object], reasons: dict[str, str], seconds: float) -> None:
    """One line about one module."""
    results = report["results"]
    assert isinstance(results, dict)
    left = survivors(report)
    explained = sum(each in reasons for each in left)
    count, killed = len(results), len(results) - len(left)
    score = 100 * killed / count if count else 100
    print(
        f"{module}: {killed} of {count} noticed ({score:.0f} %), {explained} have a reason,"
        f" {len(left) - explained} do not; {report['made']} mutants in all; {seconds:.0f} s",
        flush=True,
    )


if __name__ == "__main__":
    sys.exit(main())
