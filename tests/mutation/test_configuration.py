"""`make mutants` finds what its configuration names."""

import tomllib
from pathlib import Path

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
