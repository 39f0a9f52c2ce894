"""Which names of the robot other machines may use."""

from __future__ import annotations

import pytest

from taskrpc.bridges.gateway import Allowed


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


@pytest.mark.parametrize("pattern", ["", " ", "/", "/arm/", "//arm", "/arm/*,/door", "/arm open"])
def test_pattern_that_matches_no_name_is_refused(pattern):
    with pytest.raises(ValueError, match="expected a name such as /arm/open or '/arm/\\*', got '"):
        Allowed(["/arm/*", pattern])


@pytest.mark.parametrize("pattern", ["_secret", "/_secret", "/arm/_*"])
def test_pattern_for_hidden_names_is_refused(pattern):
    with pytest.raises(ValueError, match="hidden names are never allowed; got '"):
        Allowed([pattern])


def test_patterns_that_allow_no_present_name_are_listed():
    allowed = Allowed(["/arm/*", "dor", "/leg/*"])
    present = ["/arm/open", "/door", "/leg/_hidden", "/leg/set_parameters"]
    assert allowed.unused(present) == ["dor", "/leg/*"]
    assert allowed.unused([]) == ["/arm/*", "dor", "/leg/*"]
