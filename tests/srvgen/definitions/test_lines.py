"""A full text has a definition and its dependencies."""

from hypothesis import given
from hypothesis import strategies as st

from srvgen.definitions.lines import join_full_text, split_full_text
from srvgen.files.search import BUNDLED, Search

TEXTS = st.text(st.sampled_from("ab #=-\n\r\t"))
NAMES = st.sampled_from(["a_msgs/msg/A", "b_msgs/msg/B", "c_msgs/msg/C"])


@given(TEXTS, st.dictionaries(NAMES, TEXTS))
def test_joined_texts_are_split_again(text, needed):
    assert split_full_text(join_full_text(text, needed)) == (text, needed)


def test_full_text_contains_all_dependencies(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    full = Search().full_text("std_msgs/msg/Header")
    header = (BUNDLED / "std_msgs/msg/Header.msg").read_text(encoding="utf-8")
    time = (BUNDLED / "builtin_interfaces/msg/Time.msg").read_text(encoding="utf-8")
    assert full == f"{header}\n{'=' * 80}\nMSG: builtin_interfaces/msg/Time\n{time}"
    assert split_full_text(full) == (header, {"builtin_interfaces/msg/Time": time})
