"""The path of a file gives the type; its bytes must be UTF-8."""

import os
from pathlib import Path

import pytest

from srvgen.cli.sources import definition_files, search_paths
from srvgen.errors import DefinitionError
from srvgen.files.reading import decode, kind_of, package_of, read_definition


def write(path: Path, data: bytes = b"---\n") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def test_a_file_is_named_after_itself_and_the_folder_above_its_kind(tmp_path):
    path = write(tmp_path / "my_msgs" / "srv" / "Fetch.srv")
    assert read_definition(path).full_name == "my_msgs/srv/Fetch"
    assert read_definition(path, "other_msgs").full_name == "other_msgs/srv/Fetch"


def test_a_file_outside_a_package_takes_a_valid_name_from_its_folder(tmp_path):
    assert package_of(write(tmp_path / "My Robot" / "Fetch.srv")) == "my_robot"
    assert package_of(write(tmp_path / "123" / "Fetch.srv")) == "unnamed_package"


@pytest.mark.parametrize(
    ("data", "message", "hint"),
    [
        ("int32 a\n".encode("utf-16"), "got UTF-16", 'save the file as "UTF-8"'),
        ("int32 a\n".encode("utf-16-le"), "got UTF-16", 'save the file as "UTF-8"'),
        ("int32 a\n# größer\n".encode("latin-1"), "got the byte 0xF6", 'as "UTF-8"'),
        (b"\xef\xbb\xbfint32 a\n", "got a byte order mark", "UTF-8 with BOM"),
    ],
)
def test_file_that_is_not_utf_8_is_refused_with_a_hint(tmp_path, data, message, hint):
    path = write(tmp_path / "my_msgs" / "msg" / "Text.msg", data)
    with pytest.raises(DefinitionError) as caught:
        read_definition(path)
    assert caught.value.path == str(path)
    assert message in caught.value.message
    assert hint in caught.value.hint


def test_invalid_byte_is_shown_with_its_position():
    with pytest.raises(DefinitionError) as caught:
        decode("int32 a\n# größer\n".encode("latin-1"), "Text.msg")
    assert (caught.value.line, caught.value.column) == (2, 5)
    assert caught.value.source_line == "# gr\N{REPLACEMENT CHARACTER}"


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        (
            "Fetch.srv.txt",
            "rename the file to Fetch.srv; file managers may hide .txt",
        ),
        ("Fetch.SRV", "rename the file to Fetch.srv"),
        ("Fetch.txt", ""),
    ],
)
def test_wrong_extension_is_refused_with_the_right_one(name, hint):
    with pytest.raises(DefinitionError) as caught:
        kind_of(Path(name))
    assert caught.value.hint == hint


def test_a_file_that_cannot_be_read_is_an_error_of_its_path(tmp_path):
    with pytest.raises(DefinitionError, match="expected a readable file"):
        read_definition(tmp_path / "my_msgs" / "msg" / "Gone.msg")


def test_a_file_in_a_subfolder_belongs_to_the_package_above_that_has_a_manifest(tmp_path):
    path = write(tmp_path / "my_msgs" / "srv" / "arm" / "left" / "Fetch.srv")
    assert read_definition(path).full_name == "left/srv/Fetch"
    write(tmp_path / "my_msgs" / "package.xml", b"<package/>")
    assert read_definition(path).full_name == "my_msgs/srv/Fetch"
    plain = write(tmp_path / "my_msgs" / "srv" / "Put.srv")
    for source in (tmp_path / "my_msgs", tmp_path):
        assert definition_files(source) == [plain, path]
    for source in (path, path.parent, plain.parent):
        assert search_paths([str(source)]) == [tmp_path / "my_msgs", tmp_path]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no named pipes among its files")
def test_a_pipe_or_a_device_is_refused_and_not_waited_for(tmp_path):
    pipe, device = tmp_path / "F.srv", tmp_path / "Z.srv"
    os.mkfifo(pipe)
    device.symlink_to("/dev/zero")
    for path in (pipe, device):
        with pytest.raises(DefinitionError, match="expected a file, got a pipe or a device"):
            read_definition(path)


def test_a_huge_file_is_refused(tmp_path):
    path = tmp_path / "Huge.msg"
    with path.open("wb") as file:
        file.truncate(2**32)
    with pytest.raises(DefinitionError, match="expected a definition of at most 4 MiB"):
        read_definition(path)
