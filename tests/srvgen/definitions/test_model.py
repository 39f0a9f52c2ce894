"""The model of definitions: types, their text and their names."""

from hypothesis import given
from hypothesis import strategies as st

from srvgen.definitions.model import Field, FieldType
from srvgen.parser import parse_msg

INTEGERS = st.sampled_from(["int8", "uint8", "int16", "uint32", "int64", "byte", "char"])
QUOTABLE = st.text(
    st.characters(blacklist_characters="#\\=\"'", blacklist_categories=("Cc", "Zl", "Zp"))
)


FIELD_NAMES = st.from_regex(r"[a-z][a-z0-9]{0,5}(_[a-z0-9]{1,4}){0,2}", fullmatch=True)


def defaults(kind):
    match kind.base:
        case "float64":
            one = st.floats(allow_nan=False)
        case "bool":
            one = st.booleans()
        case "string":
            one = QUOTABLE.map(lambda text: text.strip()[: kind.string_bound or None].strip())
        case _:
            one = st.integers(0, 127)
    if not kind.is_array:
        return one
    least = kind.array_size if kind.is_fixed_array else 0
    return st.lists(one, min_size=least, max_size=kind.array_size or 4).map(tuple)


@st.composite
def field_types(draw):
    base = draw(st.one_of(INTEGERS, st.sampled_from(["float64", "bool", "string"])))
    bound = draw(st.none() | st.integers(1, 9)) if base == "string" else None
    size = draw(st.none() | st.integers(1, 4))
    is_array = size is not None or draw(st.booleans())
    upper = size is not None and draw(st.booleans())
    return FieldType(base, None, bound, is_array, size, upper)


@st.composite
def message_fields(draw):
    names = draw(st.lists(FIELD_NAMES, unique=True, max_size=5))
    kinds = [draw(field_types()) for _ in names]
    return [
        Field(name, kind, draw(st.none() | defaults(kind)))
        for name, kind in zip(names, kinds, strict=True)
    ]


def as_text(value):
    if isinstance(value, tuple):
        return f"[{', '.join(as_text(one) for one in value)}]"
    return f'"{value}"' if isinstance(value, str) else repr(value)


@given(message_fields())
def test_fields_written_as_text_are_parsed_unchanged(fields):
    text = "\n".join(
        f"{field.type} {field.name}"
        + ("" if field.default is None else f" {as_text(field.default)}")
        for field in fields
    )
    read = parse_msg(text, "my_msgs", "Any").fields
    assert [(one.name, one.type, one.default) for one in read] == [
        (one.name, one.type, one.default) for one in fields
    ]
