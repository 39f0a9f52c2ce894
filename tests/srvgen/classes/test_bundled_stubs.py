"""The committed stubs of the packages that come with srvgen."""

from __future__ import annotations

from tests.types.bundled_stubs import committed, expected


def test_committed_stubs_are_those_that_srvgen_writes():
    # If this fails: python -m tests.types.bundled_stubs
    wanted, found = expected(), committed()
    assert sorted(found) == sorted(wanted)
    assert [path for path, text in wanted.items() if found[path] != text] == []
