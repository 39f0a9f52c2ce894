"""Which names of the robot other machines may use."""

from __future__ import annotations

import pytest

from taskrpc.gateway import Allowed


@pytest.mark.parametrize(
    ("patterns", "name", "allowed"),
    [
        (["/arm/*"], "/arm/open", True),
        (["/arm/*"], "/arm/left/open", True),
        (["/arm/*"], "/leg/open", False),
        (["arm/open"], "/arm/open", True),
        (["/arm/open"], "/arm/opened", False),
        (["/ARM/*"], "/arm/open", False),
        (["/a?m/open"], "/arm/open", True),
        (["*"], "/anything", True),
        (["*"], "/_hidden", False),
        (["*"], "/arm/_private", False),
        (["*"], "/arm/set_parameters", False),
        (["/arm/*"], "/arm/set_parameters", False),
        (["/arm/set_parameters"], "/arm/set_parameters", True),
        (["*/list_parameters"], "/arm/list_parameters", True),
        (["*", "/arm/list_parameters"], "/arm/set_parameters", False),
        (["/arm/*", "/leg/set_parameters"], "/leg/set_parameters", True),
        (["/arm/*", "/leg/set_parameters"], "/arm/set_parameters", False),
        ([], "/arm/open", False),
    ],
)
def test_names(patterns, name, allowed):
    assert (name in Allowed(patterns)) is allowed
