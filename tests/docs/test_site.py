"""The documentation site: what `docs/site/make.py` makes of the project's pages."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def make():
    path = ROOT / "docs" / "site" / "make.py"
    spec = importlib.util.spec_from_file_location("make_site", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("text", "converted", "linked"),
    [
        ("[a](b.md#c)", "[a](b.md#c)", []),
        ("[a](../taskrpc/client.py)", "[a](../taskrpc/client.py.md)", ["taskrpc/client.py"]),
        ("[a](../examples/01_add_two_ints/)", "[a](../examples/01_add_two_ints/README.md)", []),
        ("![a](pictures/phone.png)", "![a](pictures/phone.png)", ["docs/pictures/phone.png"]),
        ("![w:9 A](pictures/a.png)", "![A](pictures/a.png)", ["docs/pictures/a.png"]),
        ('<img src="pictures/a.png">', '<img src="pictures/a.png">', ["docs/pictures/a.png"]),
        ("[a](https://ros.org)", "[a](https://ros.org)", []),
        ("```text\n[a](client.py)\n```", "```text\n[a](client.py)\n```", []),
        ("`a.py`\n\n```python\n1\n```", '```python title="a.py"\n1\n```', []),
        ("<!-- exits: 1 -->\n```console\n$ a\n```", "```console\n$ a\n```", []),
    ],
)
def test_a_page_keeps_its_links_and_its_files_are_copied(make, text, converted, linked):
    found, files = make.converted(text, Path("docs/page.md"))
    assert found == converted
    assert {path.as_posix() for path in files} == set(linked)


def test_the_navigation_has_every_page_once(make, tmp_path):
    make.stage(tmp_path)
    targets = list(make._targets(make.nav(tmp_path)))
    staged = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.md")}
    assert sorted(targets) == sorted(staged)


def test_every_module_of_the_reference_exists(make):
    assert all(importlib.util.find_spec(name) for name in make.MODULES)
