"""`srvgen fix` repairs only errors that have exactly one correction."""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srvgen.errors import DefinitionError
from srvgen.files.fix import fix_file, fixed
from srvgen.files.reading import parse_definition

pytestmark = pytest.mark.usefixtures("workspace")


def put(name: str, data: bytes | str) -> Path:
    path = Path("my_msgs", name.rpartition(".")[2].replace("txt", "srv"), name)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    return path


def missing(name: str) -> bool:
    return name.startswith("my_msgs/")


def fix(text: str, kind="msg", name="Thing") -> str:
    return fixed(text, "my_msgs", kind, name, missing)


@pytest.mark.parametrize(
    ("slip", "right"),
    [
        ("Header header", "std_msgs/Header header"),
        ("Header[] headers", "std_msgs/Header[] headers"),
        ("time stamp", "builtin_interfaces/Time stamp"),
        ("duration[2] d", "builtin_interfaces/Duration[2] d"),
        ("int a", "int32 a"),
        ("int[3] a", "int32[3] a"),
        ("double a # why", "float64 a # why"),
        ("boolean ok", "bool ok"),
        ("std::string name", "string name"),
        ("Double a", "float64 a"),
        ("Boolean[] flags", "bool[] flags"),
        ("geometry_msgs/msg/Point p", "geometry_msgs/Point p"),
        ("geometry_msgs::msg::Point p", "geometry_msgs/Point p"),
        ("geometry_msgs.msg.Point[] p", "geometry_msgs/Point[] p"),
        ("float64 maxSpeed", "float64 max_speed"),
        ("float64 Speed", "float64 speed"),
        ("float64 speed_  # [m/s]", "float64 speed  # [m/s]"),
        ("float64 robot__speed", "float64 robot_speed"),
        ("float64 speed;", "float64 speed"),
        ("float64 maxSpeed;", "float64 max_speed"),
        ("float64 values[3]", "float64[3] values"),
        ("float64 values[]", "float64[] values"),
        ("float64 [3] values", "float64[3] values"),
        ("int32[<= 5] few", "int32[<=5] few"),
        ("speed float64", "float64 speed"),
        ("int32 LIMIT_=1", "int32 LIMIT=1"),
        ("float32 PI=3,14", "float32 PI=3.14"),
        ("char LETTER='a'", "char LETTER=97"),
        ("  int32 a", "int32 a"),
        ("\tint32\ta", "int32\ta"),
        ("- int32 a", "int32 a"),
        ("\u2022 int32 a", "int32 a"),
        ("int32\u00a0a", "int32 a"),
        ("int32\u200b a", "int32 a"),
        ("int a // why", "int32 a # why"),
        ("int32_t a", "int32 a"),
        ("unsigned int a", "uint32 a"),
        ("int32 LIMIT=3;", "int32 LIMIT=3"),
        ("float32 a 1.0f;", "float32 a 1.0"),
        ("int32[3] a = {1,2,3}", "int32[3] a [1,2,3]"),
        ("int32 a, b // why", "int32 a\nint32 b # why"),
        ("int32 a; // why", "int32 a # why"),
        ("int32 a 3 // why", "int32 a 3 # why"),
        ("const int32 A=3", "int32 A=3"),
        ("repeated int32 a", "int32[] a"),
        ("string <= 5 a", "string<=5 a"),
        ("geometry_msgs/Point.msg p", "geometry_msgs/Point p"),
        ("x: int32", "int32 x"),
        ("// why", "# why"),
        ("/* why */", "# why"),
    ],
)
def test_error_with_one_correction_is_repaired(slip, right):
    assert fix(f"{slip}\n") == f"{right}\n"
    parse_definition(f"{right}\n", "my_msgs", "msg", "Thing")


@pytest.mark.parametrize(
    "text",
    [
        "int32 max_tries=3\n",  # a constant in capitals, or a default without '='
        "int32 maxTries=3\n",
        "int8 MODE 1\n",
        "long a\n",  # 32 or 64 bits: languages differ
        "bytes data\n",
        "std_msg/String a\n",
        "Nonsense a\n",
        "Int64 a\n",  # int64 or std_msgs/Int64
        "String[] names\n",
        "int32 gr\u00f6\u00dfe\n",
        "bool ok yes\n",
        "int32 max_speed\nint32 maxSpeed\n",
        "int32[N] a\n",
        "string x \u201cabc\u201d\n",
        'string x "a#b"\n',
        "int32 2nd\n",
        "@optional\n",
    ],
)
def test_error_with_several_corrections_or_none_is_not_repaired(text):
    assert fix(text) == text


@pytest.mark.parametrize(
    "line", ["--", "----", "\u2014", " --- ", "- - -", "===", "\u2013\u2013\u2013"]
)
def test_a_separator_is_three_hyphens(line):
    assert fix(f"int32 a\n{line}\nint32 b\n", "srv") == "int32 a\n---\nint32 b\n"


def test_a_comment_behind_a_separator_gets_its_own_line():
    assert fix("int32 a\r\n--- # answer\r\n", "srv") == "int32 a\r\n---\r\n# answer\r\n"


def test_added_line_gets_the_same_line_end():
    text = "int32 a, b\nint32 c, d\r\nint32 e, f\rint32 g, h"
    lines = [f"int32 {name}" for name in "abcdefgh"]
    ends = ["\n", "\n", "\r\n", "\r\n", "\r", "\r", "\r", ""]
    assert fix(text) == "".join(line + end for line, end in zip(lines, ends, strict=True))


def test_word_in_a_comment_does_not_prevent_a_repair():
    text = "# max_speed is in m/s\nint32 a # not max_speed\nfloat64 maxSpeed # a max_speed\n"
    assert fix(text) == text.replace("maxSpeed", "max_speed")


def test_ambiguous_separator_is_not_repaired():
    text = "int32 a\n--\nint32 b\n==\nint32 c\n"
    assert fix(text, "srv") == text


def test_repair_does_not_create_a_duplicate_name():
    assert fix("int32 maxSpeed\nint32 MaxSpeed\n") == "int32 max_speed\nint32 MaxSpeed\n"
    both = "int32 maxSpeed\n---\nint32 max_speed\n"
    assert fix(both, "srv") == "int32 max_speed\n---\nint32 max_speed\n"


def test_a_type_that_the_package_has_keeps_its_name():
    text = "Header header\nString text\n"
    assert fixed(text, "my_msgs", "msg", "Thing", lambda name: False) == text


def test_error_without_a_repair_does_not_prevent_other_repairs():
    text = "Header header\nnonsense\nfloat64 maxSpeed // m/s\n"
    assert fix(text) == "std_msgs/Header header\nnonsense\nfloat64 max_speed # m/s\n"


SLIPS = st.lists(
    st.sampled_from(
        "int a;int32 b;--;---;Header h;- int32 c;int32 maxSpeed;# why;;float64 x[3];\u2014;time t;"
        "string s // x;long l;int32 A_=1;speed float64;int32\u00a0d;nonsense;  int8 e".split(";")
    ),
    max_size=8,
)


@given(SLIPS, st.sampled_from(["\n", "\r\n"]), st.sampled_from(["msg", "srv", "action"]))
def test_fixing_again_changes_nothing_and_adds_no_errors(lines, newline, kind):
    text = "".join(line + newline for line in lines)
    once = fix(text, kind)
    assert fix(once, kind) == once
    assert once.count(newline) >= len(lines)
    assert newline == "\n" or once.count("\n") == once.count("\r\n")
    try:
        parse_definition(text, "my_msgs", kind, "Thing")
    except DefinitionError:
        return
    parse_definition(once, "my_msgs", kind, "Thing")
    if "time" not in text:
        assert fixed(text, "my_msgs", kind, "Thing", lambda name: False) == text


@given(st.text(max_size=60), st.sampled_from(["msg", "srv"]))
def test_fixing_any_text_twice_changes_nothing_more(text, kind):
    once = fix(text, kind)
    assert fix(once, kind) == once


@pytest.mark.parametrize(
    ("data", "encoding"),
    [
        (b"\xef\xbb\xbfint32 a\r\n---\r\n", "UTF-8 with BOM"),
        ("\ufeffint32 a\r\n---\r\n".encode("utf-16-le"), "UTF-16"),
        ("\ufeffint32 a\r\n---\r\n".encode("utf-16-be"), "UTF-16"),
        ("int32 a\r\n---\r\n".encode("utf-16-le"), "UTF-16"),
        ("int32 a\r\n---\r\n".encode("utf-16-be"), "UTF-16"),
    ],
)
def test_every_encoding_of_windows_becomes_plain_utf_8(run, data, encoding):
    path = put("Ask.srv", data)
    assert fix_file(path, missing).encoding == encoding
    assert run("fix", path) == (0, f"fixed {path}\n", "")
    assert path.read_bytes() == b"int32 a\r\n---\r\n"


def test_bytes_of_an_unknown_encoding_are_an_error_and_stay(run):
    data = "# gr\u00f6\u00dfer\n---\n".encode("latin-1")
    path = put("Ask.srv", data)
    code, out, err = run("fix", path)
    assert (code, out, path.read_bytes()) == (1, "", data)
    assert "got the byte 0xF6" in err


def test_hidden_file_name_extension_is_removed(run):
    path = put("Ask.srv.txt", "int a\n---\n")
    assert run("fix", path.parent) == (0, f"fixed {path}, now {path.with_name('Ask.srv')}\n", "")
    assert [one.name for one in path.parent.iterdir()] == ["Ask.srv"]
    assert path.with_name("Ask.srv").read_bytes() == b"int32 a\n---\n"


def test_a_name_that_is_taken_is_not_overwritten(run):
    path = put("Ask.srv.txt", "int32 a\n---\n")
    other = put("Ask.srv", "int32 b\n---\n")
    code, _, err = run("fix", path)
    assert code == 1
    assert "cannot rename the file to Ask.srv: a file of that name exists" in err
    assert (path.exists(), other.read_bytes()) == (True, b"int32 b\n---\n")


def test_a_dry_run_prints_a_diff_and_changes_nothing(run):
    path = put("Ask.srv.txt", b"\xef\xbb\xbfint a # why\n--\n")
    before = path.read_bytes()
    new = path.with_name("Ask.srv")
    code, out, err = run("fix", "my_msgs", "--dry-run")
    assert (code, err) == (0, "")
    assert out.splitlines() == [
        f"rename from {path}",
        f"rename to {new}",
        f"encoding of {path}: UTF-8 with BOM to UTF-8",
        f"--- {path}",
        f"+++ {new}",
        "@@ -1,2 +1,2 @@",
        "-int a # why",
        "---",
        "+int32 a # why",
        "+---",
    ]
    assert (path.read_bytes(), new.exists()) == (before, False)


def test_remaining_problems_are_reported_with_exit_code_1(run):
    path = put("Ask.srv", "int a\nlong b\nNonsense c\n---\n")
    for arguments in (["fix", path, "--dry-run"], ["fix", path]):
        code, _, err = run(*arguments)
        assert code == 1
        assert f"{path}:2:1: error: expected a built-in type" in err
    put("Ask.srv", "int a\nNonsense c\n---\n")
    code, _, err = run("fix", path, "--dry-run")
    assert (code, "    Nonsense c\n" in err) == (1, True)


def test_after_a_fix_check_accepts(run):
    put("Ask.srv", "Header header\nint count\nfloat64 values[3]\n--\ntime stamp\n")
    assert run("check", "my_msgs")[0] == 1
    assert run("fix", "my_msgs")[0] == 0
    assert run("check", "my_msgs")[0] == 0
    assert run("fix", "my_msgs") == (0, "", "")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such permissions")
def test_permissions_and_links_stay(run, tmp_path):
    path = put("Ask.srv", "int a\n---\n")
    path.chmod(0o640)
    link = path.with_name("Link.srv")
    link.symlink_to(path.name)
    assert run("fix", link)[0] == 0
    assert (link.is_symlink(), path.read_bytes()) == (True, b"int32 a\n---\n")
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert sorted(os.listdir(path.parent)) == ["Ask.srv", "Link.srv"]


def test_a_file_that_cannot_be_written_stays_whole(run, monkeypatch):
    path = put("Ask.srv", "int a\n---\n")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("srvgen.files.fix.shutil.copymode", full)
    code, _, err = run("fix", path)
    assert code == 1
    assert "expected a writable file, got: No space left on device" in err
    assert (path.read_bytes(), os.listdir(path.parent)) == (b"int a\n---\n", ["Ask.srv"])


@pytest.mark.parametrize(
    ("data", "what"), [("int x # café\n".encode("utf-32"), "UTF-32"), (bytes(64), "zero bytes")]
)
def test_file_in_an_unknown_encoding_is_not_rewritten(tmp_path, data, what):
    path = tmp_path / "mine" / "msg" / "A.msg"
    path.parent.mkdir(parents=True)
    path.write_bytes(data)
    with pytest.raises(DefinitionError, match=f"expected UTF-8 text, got {what}"):
        fix_file(path, lambda name: False)
    assert path.read_bytes() == data
