"""The arguments that several commands share: numbers, options that shorten, lists of names."""

import argparse
import json

import pytest

from taskrpc.cli.shared.parsing import add_lengths, number, print_names, whole


@pytest.mark.parametrize("text", ["-1", "1.5", "x", "", "4"])
def test_a_whole_number_outside_its_range_is_refused(text):
    with pytest.raises(argparse.ArgumentTypeError, match="expected"):
        whole(0, 3)(text)


def test_a_whole_number_in_its_range_is_read():
    assert [whole(0, 3)(text) for text in ("0", "3")] == [0, 3]


@pytest.mark.parametrize("text", ["0", "-1", "nan", "x"])
def test_a_number_against_its_rule_is_refused(text):
    with pytest.raises(argparse.ArgumentTypeError, match="above 0"):
        number("above 0", lambda value: value > 0)(text)


def test_messages_are_shortened_to_128_unless_the_options_say_otherwise():
    parser = argparse.ArgumentParser()
    add_lengths(parser, flow_style="Output each array in one line")
    usual = parser.parse_args([])
    assert (usual.truncate_length, usual.full_length) == (128, False)
    assert (usual.no_arr, usual.no_str, usual.flow_style) == (False, False, False)
    given = parser.parse_args(["-f", "-l", "3", "--no-arr", "--no-str", "--flow-style"])
    assert (given.truncate_length, given.full_length) == (3, True)
    assert (given.no_arr, given.no_str, given.flow_style) == (True, True, True)


def test_names_are_printed_as_lines_as_their_number_or_as_json(capsys):
    print_names(["/a", "/b"])
    assert capsys.readouterr().out == "/a\n/b\n"
    print_names(["/a", "/b"], count=True)
    assert capsys.readouterr().out == "2\n"
    print_names(["/a", "/b"], as_json=True)
    assert json.loads(capsys.readouterr().out) == ["/a", "/b"]
