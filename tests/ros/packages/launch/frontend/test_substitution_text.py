"""Texts with `$(…)` in XML and YAML launch files."""

import importlib

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

same = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture
def reader(launch):
    return importlib.import_module("launch.frontend.substitution_text")


def test_parts_of_a_text(reader):
    call = reader.Call
    assert reader.parse_text("a $b (c)") == ["a $b (c)"]
    assert reader.parse_text("$(dirname)/x") == [call("dirname", ()), "/x"]
    assert reader.parse_text("$(env HOME '/my home')") == [
        call("env", (["HOME"], ["/my home"])),
    ]
    assert reader.parse_text("$(find-pkg-share $(var p)_x)") == [
        call("find-pkg-share", ([call("var", (["p"],)), "_x"],))
    ]
    assert reader.parse_text("$(eval 'f(1) == \\'a\\'')") == [call("eval", (["f(1) == 'a'"],))]
    assert reader.parse_text(r"\$(x) \\") == ["$(x) \\"]


@pytest.mark.parametrize("text", ["$(", "a $(var", "$(var 'x)", "$(1)", "$(var x"])
def test_unfinished_substitution_is_named(reader, text):
    with pytest.raises(reader.SubstitutionTextError, match=r"expected .* at character"):
        reader.parse_text(text)


@same
@given(st.text(alphabet="$()\\'\" ab", max_size=40))
def test_any_text_gives_parts_or_the_documented_error(reader, text):
    try:
        parts = reader.parse_text(text)
    except reader.SubstitutionTextError:
        return
    assert all(isinstance(part, (str, reader.Call)) for part in parts)


@same
@given(st.text(max_size=40))
def test_escaped_text_stays_itself(reader, text):
    escaped = text.replace("\\", "\\\\").replace("$", "\\$")
    assert reader.parse_text(escaped) == ([text] if text else [])
