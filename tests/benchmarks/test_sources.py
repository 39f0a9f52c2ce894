"""The digest of the measured code changes with the code only, and is the same on every Python."""

import pytest

from benchmarks.harness.sources import MEASURED, digest_of, sources_digest

MODULE = '''"""A module."""

import math  # for pi

LIMIT = 5
"""Things."""


class Thing:
    """A thing."""

    def name(self, n: int) -> str:
        """Return the name."""
        if n > LIMIT:
            return f"{n:>{LIMIT}} {'é' + f'x{n!r}'} {{}}"
        return "a" "b"
'''
SAME = [
    ("# for pi", "# for e"),
    ("  # for pi", ""),
    ('"""A module."""\n', ""),
    ('"""Things."""\n', ""),
    ('    """A thing."""\n', "    'A'\n\n\n"),
    ('"""Return the name."""', '"""Return\n\n        the name.\n        """'),
    ("(self, n: int)", "(\n        self, n: int\n    )"),
    ("LIMIT = 5", "LIMIT  =  5"),
]
OTHER = [
    ("LIMIT = 5", "LIMIT = 6"),
    ("n > LIMIT", "n >= LIMIT"),
    ('"a" "b"', '"a" "c"'),
    ("x{n!r}", "x{n!s}"),
    ("{{}}", "{{ }}"),
    ('        return "a"', '            return "a"'),
]


@pytest.mark.parametrize(("text", "by"), SAME)
def test_comments_docstrings_and_layout_leave_the_digest_as_it_is(text, by):
    assert text in MODULE
    assert digest_of(MODULE.replace(text, by)) == digest_of(MODULE)


@pytest.mark.parametrize(("text", "by"), OTHER)
def test_any_change_of_the_code_changes_the_digest(text, by):
    assert text in MODULE
    assert digest_of(MODULE.replace(text, by)) != digest_of(MODULE)


def test_digest_is_the_same_on_every_python():
    assert digest_of(MODULE) == "58c53247dba9ff7dcb0cf17ceaa749217e4b4112c837ef84f6f9bc68f4e1b580"


def test_renamed_and_new_modules_change_the_digest_of_the_sources(tmp_path):
    digests = []
    for name in ("a", "b", "c"):
        path = tmp_path / MEASURED[1] / "inner" / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        if name == "b":
            path.with_name("a.py").rename(path)
        path.write_text(MODULE)
        digests.append(sources_digest(tmp_path))
    assert len(set(digests)) == len(digests)
