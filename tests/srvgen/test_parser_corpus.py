"""srvgen reads a corpus of definitions exactly as the tools of ROS 2 do.

The corpus lies beside a checkout or not at all; where it is absent, these tests are skipped.
"""

import json
from functools import cache
from pathlib import Path

import pytest

from srvgen.definitions.derived import derived_types
from srvgen.definitions.literals import unescape
from srvgen.definitions.model import sections
from srvgen.describe import describe
from srvgen.errors import DefinitionError
from srvgen.files.reading import decode, parse_definition
from srvgen.typehash import hash_of, type_description

CORPUS = Path(__file__).parents[3] / "shared" / "corpus"
pytestmark = pytest.mark.skipif(not CORPUS.is_dir(), reason="the corpus is not beside the checkout")


def rows(oracle):
    with (CORPUS / "oracles" / f"{oracle}.jsonl").open(encoding="utf-8") as lines:
        return [json.loads(line) for line in lines]


@cache
def parsed(path, package, kind, name):
    text = decode((CORPUS / path).read_bytes(), path)
    return parse_definition(text, package, kind, name, path=path)


def definition(row):
    return parsed(row["path"], row["package"], row["kind"], row["name"])


def spec_without_comments(spec):
    notes = ("comment", "unit")
    return {
        section: {
            part: [
                {key: value for key, value in one.items() if key not in notes}
                for one in content[part]
            ]
            for part in ("fields", "constants")
        }
        for section, content in spec.items()
    }


def notes(spec):
    return [
        (one["name"], tuple(one.get("comment", ())), one.get("unit"))
        for content in spec.values()
        for one in (content, *content["fields"], *content["constants"])
    ]


def own_notes(model):
    return [
        (one.name, one.comment, one.unit)
        for message in sections(model)
        for one in (message, *message.fields, *message.constants)
    ]


def canonical(data):
    return json.dumps(data, sort_keys=True)


def test_every_file_has_the_official_fields_constants_and_comments():
    for row in rows("parse"):
        if row["ok"]:
            model = definition(row)
            expected = spec_without_comments(row["spec"])
            assert canonical(describe(model)["spec"]) == canonical(expected), row["path"]
            assert own_notes(model) == notes(row["spec"]), row["path"]


def test_every_file_that_the_official_parser_refuses_is_refused():
    refused = [row for row in rows("parse") if not row["ok"]]
    assert refused
    for row in refused:
        with pytest.raises(DefinitionError):
            definition(row)


def test_every_small_case_has_the_official_verdict_and_meaning():
    for row in rows("cases"):
        arguments = (row["text"], row["package"], row["kind"], row["name"])
        if row["expected"] == "error":
            with pytest.raises(DefinitionError):
                parse_definition(*arguments)
        else:
            model = parse_definition(*arguments)
            expected = spec_without_comments(row["spec"])
            assert canonical(describe(model)["spec"]) == canonical(expected), row["text"]
            assert own_notes(model) == notes(row["spec"]), row["text"]


def final_values(model):
    def final(value):
        if isinstance(value, tuple):
            return repr(tuple(final(one) for one in value))
        return unescape(value) if isinstance(value, str) else value

    keys = [section.name.rpartition("_")[2].lower() for section in sections(model)]
    if len(keys) == 1:
        keys = ["message"]
    return {
        key: {
            "idl_defaults": {
                field.name: final(field.default)
                for field in message.fields
                if field.default is not None
            },
            "idl_constants": {one.name: final(one.value) for one in message.constants},
        }
        for key, message in zip(keys, sections(model), strict=True)
    }


def nan_safe(values):
    return json.loads(json.dumps(values).replace("NaN", '{"$float": "nan"}'))


def test_defaults_and_constants_equal_those_of_the_official_idl_step():
    cases = [row for row in rows("cases") if row["pipeline"] == "ok" and row["expected"] == "ok"]
    for row in cases:
        model = parse_definition(row["text"], row["package"], row["kind"], row["name"])
        assert final_values(model) == row["pipeline_values"], row["text"]
    files = [row for row in rows("idl_values") if row["ok"]]
    assert len(files) > 100
    for row in files:
        final = final_values(definition(row))
        for section, values in row["values"].items():
            assert nan_safe(final[section]) == values, row["path"]


def test_every_type_that_can_be_resolved_has_the_official_hash_and_description():
    table = rows("rihs01")
    known = {}
    for row in table:
        owner = row["path"].partition("/")[0]
        for one in (definition(row), *derived_types(definition(row))):
            known.setdefault(one.full_name, {})[owner] = one
    checked = 0
    for row in table:
        if row["unresolved"]:
            continue
        owner = row["path"].partition("/")[0]
        own = {one.full_name: one for one in (definition(row), *derived_types(definition(row)))}

        def resolve(name, own=own, owner=owner):
            if name in own:
                return own[name]
            by_owner = known[name]
            ros2 = [one for repo, one in by_owner.items() if repo.startswith("ros2__")]
            return by_owner.get(owner) or (ros2 or list(by_owner.values()))[0]

        for name, expected in row["hashes"].items():
            assert hash_of(own[name], resolve) == expected, (row["path"], name)
            described = type_description(own[name], resolve)["type_description"]
            official = row["individual_type_descriptions"][name]
            for field in official["fields"]:
                del field["default_value"]  # no part of the hash
            assert described == official
            checked += 1
    assert checked > 2000
