"""`make mutants` finds what its configuration names, and names survivors as the reasons do."""

import tomllib
from pathlib import Path

from tests.mutation.mutants import survivors

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
MODULES = tomllib.loads((HERE / "modules.toml").read_text())
REASONS = tomllib.loads((HERE / "reasons.toml").read_text())


def test_modules_and_their_tests_exist():
    tests = [f"tests/{test}" for of_module in MODULES.values() for test in of_module]
    missing = sorted({path for path in [*MODULES, *tests] if not (ROOT / path).exists()})
    assert not missing, "change tests/mutation/modules.toml"
    assert all(MODULES.values()), "each module needs tests"


def test_only_configured_modules_have_reasons_and_no_reason_is_empty():
    assert set(REASONS) <= set(MODULES)
    assert all(each.strip() for reasons in REASONS.values() for each in reasons.values())


def test_reasons_name_functions_of_their_modules():
    gone = []
    for module, reasons in REASONS.items():
        code = (ROOT / module).read_text()
        names = {survivor: survivor.partition(":")[0].rpartition(".")[2] for survivor in reasons}
        gone += [survivor for survivor, name in names.items() if f"def {name}(" not in code]
    assert not gone, "remove them from tests/mutation/reasons.toml"


def test_survivor_is_named_by_its_function_and_lines_and_not_by_its_number():
    diff = (
        "--- taskrpc/retry.py\n+++ taskrpc/retry.py\n@@ -1,3 +1,3 @@\n"
        " def book(self):\n-    self.booked += 1\n+    pass\n"
    )
    results = {
        "taskrpc.retry.xǁRetryBudgetǁbook__mutmut_12": {"status": "survived", "diff": diff},
        "taskrpc.retry.x_reconnect_delay__mutmut_3": {"status": "no tests", "diff": diff},
        "taskrpc.retry.x_reconnect_delay__mutmut_4": {"status": "killed", "diff": ""},
    }
    assert survivors({"made": 3, "results": results}) == [
        "RetryBudget.book: self.booked += 1 → pass",
        "reconnect_delay: self.booked += 1 → pass",
    ]
