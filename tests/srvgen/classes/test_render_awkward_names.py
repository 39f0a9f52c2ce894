"""Fields, constants and types may be named like Python keywords or parts of generated classes."""

from __future__ import annotations

import copy
import keyword
import pickle
from pathlib import Path

import msgspec
import pytest

import srvgen
from srvgen._runtime import encode_hook
from srvgen.classes.generate import generate
from srvgen.classes.importer import uninstall_import_hook
from srvgen.classes.stubs import packages_with_dependencies, stubs
from srvgen.files.reading import read_definition
from srvgen.files.search import BUNDLED, Search
from tests.srvgen.sample_definitions import put_all

WORDS = """
self cls data type id list int str bytes float array msgspec field default property none bool object
get_fields_and_field_types copy tuple dict set len range super typing math builtins runtime message
check path paths error value values match case name items keys fields nested hash annotations doc
module init t mro any print slot_types
"""
NAMES = sorted({*WORDS.split(), *(word for word in keyword.kwlist if word.islower())})
TYPES = """
List Struct Any Optional Message Service Action Type Self Object Float32Array NumericArray Ints
Floats FieldError Literal ClassVar TypeAlias Exception ValueError NotImplementedError Byte
""".split()


def each(*lines: str) -> str:
    return "".join(line.format(name) + "\n" for name in NAMES for line in lines)


DEFINITIONS = {
    "msg/Integers": each("int32 {} 7"),
    "msg/Singles": each("float32 {}"),
    "msg/Strings": each("string<=5 {} 'a'", "string[] {}2 ['b']"),
    "msg/Truths": each("bool {}", "bool[3] {}2"),
    "msg/Bytes": each("byte {}", "byte[] {}2 [1, 2]"),
    "msg/Arrays": each("float64[] {}", "int8[2] {}2 [1, 2]"),
    "msg/Nest": "".join(
        f"{type_} {name}\n{type_}[] {name}2\n{type_}[2] {name}3\n"
        for type_, name in zip(TYPES * 4, NAMES, strict=False)
    ),
    "msg/Constants": "".join(f"int32 {name.upper()}=3\n" for name in NAMES if "__" not in name)
    + "List list\nNest nest\n",
    "msg/A": "int32 A=3\nint32 x\n",
    "msg/UsesA": "int32 A=3\nA x\nA[] y\n",
    **{f"msg/{name}": "int32 a 3\n" for name in TYPES},
    "srv/List": "int32 a\nList b\n---\nList[] c\n",
    "srv/Request": "int32 request\n---\nint32 response\n",
    "srv/ValueError": "Nest a\n---\n",
    "action/Goal": "int32 goal\n---\nint32 status\n---\nint32 goal_id\n",
    "action/Impl": "Nest result\n---\nint32 impl\n---\nint32 feedback\n",
}


@pytest.fixture(scope="module")
def package(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("awkward") / "odd_msgs"
    put_all({f"{name}.{name.split('/')[0]}": text for name, text in DEFINITIONS.items()}, folder)
    return folder


@pytest.fixture
def hook(package):
    srvgen.install_import_hook(package)
    yield
    uninstall_import_hook()


def classes(name: str) -> list[type]:
    loaded = srvgen.load(f"odd_msgs/{name}")
    if hasattr(loaded, "_FIELDS"):
        return [loaded]
    if hasattr(loaded, "Request"):
        return [loaded.Request, loaded.Response, loaded.Event]
    return [loaded.Goal, loaded.Result, loaded.Feedback, loaded.Impl.FeedbackMessage]


@pytest.mark.parametrize("name", DEFINITIONS)
def test_every_class_is_made_set_sent_copied_and_printed(hook, name):
    for cls in classes(name):
        message = cls()
        message._check()
        names = [field for field, _ in cls._FIELDS]
        readable = [one for one in names if one != "get_fields_and_field_types"]
        assert cls(**{one: getattr(message, one) for one in readable}) == message
        for one in readable:
            setattr(message, one, getattr(message, one))
        assert list(cls.get_fields_and_field_types()) == names
        assert all(f"{one}=" in repr(message) for one in names)
        encoded = msgspec.msgpack.Encoder(enc_hook=encode_hook).encode(message)
        arrived = msgspec.msgpack.Decoder(cls).decode(encoded)
        arrived._check()
        plain = srvgen.to_builtins(message)
        assert list(plain) == names
        assert message == arrived == srvgen.from_builtins(cls, plain)
        assert message == srvgen.from_cdr(cls, srvgen.to_cdr(message))
        assert message == copy.deepcopy(message) == pickle.loads(pickle.dumps(message))


@pytest.mark.types
def test_their_packages_and_stubs_pass_mypy(package, tmp_path, mypy):
    search = Search([package, BUNDLED])
    parsed = [read_definition(path) for path in sorted(package.glob("*/*.*"))]
    needed, problems = packages_with_dependencies(["odd_msgs"], search)
    assert not problems
    written = {"made": generate({"odd_msgs": parsed}, search), "typings": stubs(needed)}
    for folder, files in written.items():
        put_all(files, tmp_path / folder)
        (result,) = mypy("--follow-imports=silent", tmp_path / folder)
        assert result.startswith("Success: no issues found in ")
