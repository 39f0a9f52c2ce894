"""Runs mutmut on one module, in the folder that `mutants.py` has created.

It has a process of its own, since mutmut keeps its configuration and results in the process.
"""

from __future__ import annotations

import json
import random
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import operators

operators.install()

import mutmut.__main__ as mutmut_command  # noqa: E402
from mutmut.mutation.data import SourceFileMutationData  # noqa: E402
from mutmut.mutation.diff_apply import get_diff_for_mutant  # noqa: E402
from mutmut.mutation.file_mutation import mutate_file_contents  # noqa: E402
from mutmut.stats import status_by_exit_code  # noqa: E402
from mutmut.utils.format_utils import get_mutant_name  # noqa: E402


def main(module: str, size: int, seed: int, children: int, report: str, again: str = "") -> None:
    """Test `size` mutants of a module (0: all of them), and write what became of each.

    With `again`, an earlier report, only those that survived then.
    """
    path = Path(module)
    names = sorted(
        get_mutant_name(path, name)
        for name in mutate_file_contents(module, path.read_text()).mutant_names
    )
    made = len(names)
    if again:
        before = json.loads(Path(again).read_text())[module]["results"]
        names = [name for name in names if name in before and before[name]["diff"]]
    elif 0 < size < made:
        names = sorted(random.Random(f"{seed} {module}").sample(names, size))
    if names:
        mutmut_command._run(names, children)
    data = SourceFileMutationData(path=path)
    data.load()
    results = {}
    for name in names:
        status = status_by_exit_code[data.exit_code_by_key[name]]
        seen = status in ("killed", "timeout", "segfault", "suspicious")
        results[name] = {
            "status": status,
            "diff": "" if seen else get_diff_for_mutant(name, path=path),
        }
    Path(report).write_text(json.dumps({"made": made, "results": results}, indent=1))


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:5]), *sys.argv[5:])
