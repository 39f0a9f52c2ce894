"""Fault harnesses: `pytest -m faults` runs the small sizes, `--soak` the large ones."""

from __future__ import annotations

import pytest

from tests.faults.harness import HAPPENED, Bug, Counts, PromiseBroken
from tests.faults.programs import Programs


def pytest_generate_tests(metafunc):
    """Run each test once unchanged, and once more with each planted bug."""
    if (marker := metafunc.definition.get_closest_marker("planted")) is not None:
        named = [pytest.param(bug, id=bug.name) for bug in marker.args]
        metafunc.fixturenames.append("bug")
        metafunc.parametrize("bug", [pytest.param(None, id="as_it_is"), *named])


def planted(item) -> Bug | None:
    callspec = getattr(item, "callspec", None)
    return None if callspec is None else callspec.params.get("bug")


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem):
    """With a planted bug, a harness must fail, and by the count that the bug names."""
    try:
        return (yield from _judged(planted(pyfuncitem)))
    finally:
        if counts := pyfuncitem.funcargs.get("counts"):
            pyfuncitem.user_properties.append((HAPPENED, str(counts)))


def _judged(bug):
    if bug is None:
        return (yield)
    try:
        with bug.planted():
            yield
    except PromiseBroken as broken:
        if bug.breaks in broken.counts:
            return True
        pytest.fail(f"{bug.name} was seen as {broken}, expected {bug.breaks}")
    return pytest.fail(f"the harness does not see what was planted: {bug.name}")


@pytest.fixture
def large(request):
    """Whether to run the large size; planted bugs must be found at the small one."""
    return request.config.getoption("soak") and planted(request.node) is None


@pytest.fixture
def programs(request, tmp_path):
    """Starts programs that end with the test; a planted bug is planted in them as well."""
    with Programs(tmp_path, planted(request.node)) as programs:
        yield programs


@pytest.fixture
def seed(request):
    """The seed of all random choices; `--seed` sets another one."""
    given = request.config.getoption("seed")
    print(f"seed {given}; again with: pytest -m faults --seed {given} '{request.node.nodeid}'")
    return given


@pytest.fixture
def counts():
    """Counts what happens in this test."""
    return Counts()
