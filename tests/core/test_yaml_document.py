"""A mistake in a user's YAML file raises the reader's own error, with the place and a caret."""

import pytest

from taskrpc.core.yaml_document import Document, DocumentError


class ShelfError(DocumentError):
    """The error of this test's files."""


def shelf(text):
    return Document(text, "shelf.yaml", what="the shelf", error=ShelfError)


def fields(text):
    document = shelf(text)
    return document.fields(document.root, "a shelf", ("height",), ("boards",))


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("", "shelf.yaml: error: the shelf is empty"),
        ("boards: 1\n", "shelf.yaml: error: a shelf needs 'height'"),
        (
            "height: 1\nbords: 2\n",
            "shelf.yaml:2:1: error: a shelf has no 'bords' (did you mean 'boards'?):"
            " expected height, boards\n    bords: 2\n    ^",
        ),
        (
            "height: 1\nheight: 2\n",
            "shelf.yaml:2:1: error: a shelf: 'height' appears twice\n    height: 2\n    ^",
        ),
        (
            "- height\n",
            "shelf.yaml:1:1: error: a shelf: expected entries as `name: value`,"
            " got a list of 1\n    - height\n    ^",
        ),
        (
            "height: [1\nboards: 2",
            "shelf.yaml:2:7: error: not valid YAML: expected ',' or ']', but got ':'\n"
            "    boards: 2\n          ^",
        ),
    ],
)
def test_a_mistake_is_shown_at_its_place(text, error):
    with pytest.raises(ShelfError) as caught:
        fields(text)
    assert str(caught.value) == error


def test_values_are_read_with_their_places():
    document = shelf("height: 1\nboards: [a, b]\n")
    found = document.fields(document.root, "a shelf", ("height", "boards"))
    assert found["height"].value == "1"
    assert found["boards"].start_mark.line == 1
    assert [each.value for each in document.items(found["boards"], "boards")] == ["a", "b"]
    assert document.items(None, "boards") == []
