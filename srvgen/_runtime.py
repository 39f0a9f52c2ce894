"""The runtime of generated message classes: base classes, arrays, and conversions of each type.

`srvgen generate` copies this file into every package that it writes. So a generated package needs
only msgspec. Therefore everything is in one file, and it imports nothing but the standard library
and msgspec. Its order: errors and conversions of single values, arrays, checks that generated code
calls, and the base classes of messages, services and actions.

Encoders, loaders and transports use these attributes of a message class: `_TYPE`, `_HASH`,
`_FIELDS`, `_NESTED`, `_DECODES_EXACTLY` and `_check`, and `_CODE` of an array. They begin with an
underscore because the name of a field cannot: so they never collide with a field.
"""

from __future__ import annotations

import operator
import reprlib
import struct
import sys
from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence, Sized
from copy import deepcopy
from functools import cache, partial
from types import GenericAlias
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Generic, NoReturn, Self, TypeVar

import msgspec


class FieldError(ValueError):
    """A field has a value that its type does not allow.

    Attributes:
        path: the field, from the message that was checked: `goal.position.x`, `ranges[3]`.
        problem: what was expected and what was received.
    """

    def __init__(self, path: str, problem: str) -> None:
        super().__init__(path, problem)
        self.path = path
        self.problem = problem

    def __str__(self) -> str:
        return f"{self.path}: {self.problem}" if self.path else self.problem


def with_prefix(error: ValueError, name: str) -> FieldError:
    """The same error with the field `name` put in front of its path."""
    # The error may come from the copy of this file in another package: use only its attributes.
    path = str(getattr(error, "path", ""))
    joined = f"{name}.{path}" if name and path and path[0] != "[" else name + path
    return FieldError(joined, str(getattr(error, "problem", error)))


def short_repr(value: object) -> str:
    """A short text for a wrong value, with its type: `'abc' (str)`."""
    try:
        text = reprlib.repr(value)
    except ValueError:  # an int too long to print
        text = "a value"
    return text if value is None else f"{text} ({type(value).__name__})"


def _wrong(path: str, expected: str, value: object) -> NoReturn:
    raise FieldError(path, f"expected {expected}, got {short_repr(value)}")


def _integer(name: str, low: int, high: int) -> Callable[[object, str], int]:
    def convert(value: object, path: str) -> int:
        try:
            number = int(operator.index(value))  # type: ignore[arg-type]
        except TypeError:
            _wrong(path, name, value)
        if low <= number <= high:
            return number
        text = reprlib.repr(number) if abs(number) < 1 << 256 else "a far larger number"
        raise FieldError(path, f"expected {name} in {low}..{high}, got {text}")

    convert.__name__ = f"to_{name}"
    return convert


to_int8 = _integer("int8", -(2**7), 2**7 - 1)
to_uint8 = _integer("uint8", 0, 2**8 - 1)
to_int16 = _integer("int16", -(2**15), 2**15 - 1)
to_uint16 = _integer("uint16", 0, 2**16 - 1)
to_int32 = _integer("int32", -(2**31), 2**31 - 1)
to_uint32 = _integer("uint32", 0, 2**32 - 1)
to_int64 = _integer("int64", -(2**63), 2**63 - 1)
to_uint64 = _integer("uint64", 0, 2**64 - 1)


NOT_FLOAT = (struct.error, TypeError, OverflowError)
"""The errors of packing a value that is not a float or is too large."""


def _floating(name: str, code: str, top: str) -> Callable[[Any, str], float]:
    layout = struct.Struct(code)

    def convert(value: Any, path: str) -> float:
        try:
            number: float = layout.unpack(layout.pack(value))[0]
        except NOT_FLOAT:
            is_number = hasattr(value, "__float__")
            _wrong(path, f"{name} in -{top}..{top}" if is_number else name, value)
        return number

    convert.__name__ = f"to_{name}"
    return convert


# Rounded to the nearest float32 here, so that every transport carries the same value.
to_float32 = _floating("float32", "<f", "3.4028235e+38")
to_float64 = _floating("float64", "<d", "1.7976931348623157e+308")


@cache
def float32s(count: int) -> tuple[Callable[..., bytes], Callable[[bytes], tuple[Any, ...]]]:
    """Functions that pack and unpack so many float32 at once, four times faster than one by one."""
    layout = struct.Struct(f"<{count}f")
    return layout.pack, layout.unpack


def to_boolean(value: object, path: str) -> bool:
    """Convert to a boolean; 0, 1 and booleans of numpy are accepted."""
    if isinstance(value, int) and value in (0, 1):
        return bool(value)
    if type(value).__module__ == "numpy" and type(value).__name__ in ("bool", "bool_"):
        return bool(value)
    _wrong(path, "true or false", value)


def to_byte(value: object, path: str) -> bytes:
    """Convert `bytes` of length 1 or an integer 0..255 to `bytes` of length 1."""
    if isinstance(value, (bytes, bytearray)):
        if len(value) == 1:
            return bytes(value)
        _wrong(path, "one byte", value)
    return bytes((to_uint8(value, path),))


def to_text(value: object, path: str, bound: int | None = None) -> str:
    """Check that a string can be encoded as UTF-8 and has at most `bound` characters."""
    if not isinstance(value, str):
        _wrong(path, "string", value)
    text = str.__str__(value)
    if bound is not None and len(text) > bound:
        raise FieldError(path, f"expected at most {bound} characters, got {len(text)}")
    try:
        text.encode()
    except UnicodeEncodeError as error:
        problem = f"expected text that UTF-8 can encode, got a lone surrogate at {error.start}"
        raise FieldError(path, problem) from None
    return text


def bounded_text(bound: int) -> Callable[[Any, str], str]:
    """`to_text` with this bound."""
    return partial(to_text, bound=bound)


Number = TypeVar("Number", int, float)
_SWAPPED = sys.byteorder == "big"
_NATIVE = ">" if _SWAPPED else "<"
_KINDS = {code: kind for kind in ("bhilq", "BHILQ", "f", "d") for code in kind}
_new = array.__new__
_item = array.__getitem__


if TYPE_CHECKING:
    _Elements = array
else:

    class _Elements(array):
        # `array` of Python 3.11 cannot be subscripted in annotations.
        __slots__ = ()
        __class_getitem__ = classmethod(GenericAlias)


class NumericArray(_Elements[Number]):
    """A sequence of one numeric type; compares equal to a list of the same numbers.

    Accepts any iterable of numbers; `bytes` and `bytearray` are raw little-endian elements.

    Raises:
        FieldError: an element does not fit; its path is the index, `[3]`.
    """

    __slots__ = ()
    _CODE: ClassVar[str]
    """The type code of `array`."""
    _SIZE: ClassVar[int]
    """Bytes of an element."""
    _CONVERT: ClassVar[Callable[[Any, str], float]]

    if TYPE_CHECKING:  # a field accepts any iterable of numbers

        def __get__(self, instance: object, owner: type) -> Self: ...
        def __set__(self, instance: object, value: Iterable[Number]) -> None: ...

    def __new__(cls, values: Iterable[Number] = ()) -> Self:
        return cls.of(values, "")

    @classmethod
    def field(cls, default: int | tuple[float, ...] = ()) -> Any:
        """The default of a field: these elements, or this number of zeros."""
        values = bytes(default * cls._SIZE) if isinstance(default, int) else default
        return msgspec.field(default_factory=partial(_new, cls, cls._CODE, values))

    @classmethod
    def of(cls, values: Any, path: str, least: int = 0, most: int | None = None) -> Self:
        """Convert to this array, with `least` to `most` elements, or raise FieldError."""
        if type(values) is bytes or isinstance(values, bytearray):
            try:
                made = _new(cls, cls._CODE, values)
            except ValueError:
                problem = f"expected elements of {cls._SIZE} bytes, got {len(values)} bytes"
                raise FieldError(path, problem) from None
            if _SWAPPED:
                made.byteswap()
        elif isinstance(values, (list, tuple)):
            made = cls._of_items(values, path)
        else:
            made = cls._of_buffer(values, path)
        if most is not None:
            check_length(made, path, least, most)
        return made

    @classmethod
    def _of_buffer(cls, values: Any, path: str) -> Self:
        try:
            view = memoryview(values)
        except (TypeError, ValueError):  # numpy refuses views of its dates with ValueError
            return cls._of_items(to_list(values, path), path)
        if view.ndim == 0:
            _wrong(path, "a list", values)
        kind = _KINDS.get(view.format.removeprefix(_NATIVE))
        if kind == _KINDS[cls._CODE] and view.itemsize == cls._SIZE:
            made = _new(cls, cls._CODE)
            # For a large image a copy by `tobytes` is forty times slower.
            is_plain = view.format in _KINDS and view.c_contiguous and view.nbytes > 0
            made.frombytes(view.cast("B") if is_plain else view.tobytes())
            return made
        # numpy's ravel and tolist support formats that memoryview does not (float16, '>i4').
        flat = values.ravel() if hasattr(values, "ravel") else view
        try:
            items = flat.tolist()
        except NotImplementedError:
            _wrong(path, f"{cls._CONVERT.__name__.removeprefix('to_')} elements", values)
        return cls._of_items(items, path)

    @classmethod
    def _of_items(cls, items: list[Any] | tuple[Any, ...], path: str) -> Self:
        try:
            if cls._CODE != "f":
                return _new(cls, cls._CODE, items)
            # array() would silently change numbers that are too large for float32 to infinity.
            return _new(cls, cls._CODE, struct.pack(f"={len(items)}f", *items))
        except (TypeError, ValueError, OverflowError, struct.error):
            exact = [cls._CONVERT(item, f"{path}[{i}]") for i, item in enumerate(items)]
        return _new(cls, cls._CODE, exact)

    def little_endian(self) -> memoryview:
        """The bytes of the elements in the order of the wire format."""
        if not _SWAPPED:
            return memoryview(self)
        swapped = self.__copy__()
        swapped.byteswap()
        return memoryview(swapped)

    if not TYPE_CHECKING:  # `array` would return a plain array, which is not equal to a list

        def __getitem__(self, index):
            if type(index) is slice:
                return _new(type(self), self._CODE, _item(self, index))
            return _item(self, index)

    def __eq__(self, other: object) -> bool:
        if isinstance(other, (list, tuple)):
            return self.tolist() == list(other)
        if isinstance(other, (bytes, bytearray)):
            return bytes(self.little_endian()) == other
        return super().__eq__(other)

    def __ne__(self, other: object) -> bool:
        equal = self.__eq__(other)
        return equal if equal is NotImplemented else not equal

    __hash__ = None

    def __repr__(self) -> str:
        # As ROS prints it: a plain array.
        return repr(array(self._CODE, self))

    def __copy__(self) -> Self:
        return _new(type(self), self._CODE, self)

    def __deepcopy__(self, memo: object) -> Self:
        return self.__copy__()

    def __reduce_ex__(self, protocol: object) -> tuple[object, ...]:
        return type(self), (bytes(self.little_endian()),)


ARRAY_CLASSES: dict[str, type[NumericArray[Any]]] = {}
"""The classes below, by the type of their elements."""


def _array_class(code: str, convert: Callable[[Any, str], Number]) -> type[NumericArray[Number]]:
    element = convert.__name__.removeprefix("to_")
    facts = {"_CODE": code, "_SIZE": array(code).itemsize, "_CONVERT": staticmethod(convert)}
    names = {"__module__": __name__, "__slots__": (), **facts}
    ARRAY_CLASSES[element] = made = type(f"{element.capitalize()}Array", (NumericArray,), names)
    return made


Int8Array = _array_class("b", to_int8)
Uint8Array = _array_class("B", to_uint8)
Int16Array = _array_class("h", to_int16)
Uint16Array = _array_class("H", to_uint16)
Int32Array = _array_class("i", to_int32)
Uint32Array = _array_class("I", to_uint32)
Int64Array = _array_class("q", to_int64)
Uint64Array = _array_class("Q", to_uint64)
Float32Array = _array_class("f", to_float32)
Float64Array = _array_class("d", to_float64)
ARRAY_CLASSES["char"] = Uint8Array

# On the wire arrays are raw bytes, which msgspec decodes without calling Python; `_check` converts
# them to arrays. So the declared type is `bytes`, but type checkers see what a program sees.
if TYPE_CHECKING:
    Ints = NumericArray[int]
    Floats = NumericArray[float]

    class Byte:
        """A field that returns `bytes` of length 1 and also accepts 0..255."""

        def __get__(self, instance: object, owner: type) -> bytes: ...
        def __set__(self, instance: object, value: bytes | int) -> None: ...
else:
    Byte = Ints = Floats = bytes


def byte(value: bytes) -> Any:
    """The default of a `byte` field; the cast is for type checkers."""
    return value


def encode_hook(value: Any) -> memoryview:
    """The `enc_hook` of msgspec encoders; one copy works for the messages of all packages."""
    try:
        view: memoryview = value.little_endian()
    except AttributeError:
        raise NotImplementedError(f"a message cannot contain {short_repr(value)}") from None
    return view


def check_length(values: Sized, path: str, least: int, most: int | None) -> None:
    """Refuse fewer than `least` or more than `most` elements."""
    count = len(values)
    if count < least or (most is not None and count > most):
        bound, plural = least if least == most else f"at most {most}", "" if most == 1 else "s"
        raise FieldError(path, f"expected {bound} element{plural}, got {count}")


def to_list(values: Any, path: str, least: int = 0, most: int | None = None) -> list[Any]:
    """Convert to a list of `least` to `most` elements; a list is returned itself."""
    if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, Iterable):
        _wrong(path, "a list", values)
    items = values if type(values) is list else list(values)
    check_length(items, path, least, most)
    return items


def _are_exact(items: list[Any], convert: Callable[[Any, str], Any]) -> bool:
    """Whether `convert` would change no element of a list; functions of C look at the elements."""
    types = set(map(type, items))
    if convert is to_byte:
        return types == {bytes} and _are_single_bytes(items)
    if convert is to_boolean:
        return types == {bool}
    bound = convert.keywords["bound"] if isinstance(convert, partial) else None
    if types != {str} or (bound is not None and max(map(len, items)) > bound):
        return False
    try:
        "".join(items).encode()
    except UnicodeEncodeError:
        return False
    return True


def _are_single_bytes(items: list[bytes]) -> bool:
    try:
        msgspec.convert(items, _LIMITED["byte[]"])
    except msgspec.ValidationError:
        return False
    return True


def _bytes_of(items: list[Any]) -> list[bytes] | None:
    """The bytes of a list of integers 0..255; None if it has other elements."""
    try:
        raw = bytes(items)
    except (TypeError, ValueError):
        return None
    return list(struct.unpack(f"{len(raw)}c", raw))


def to_items(
    values: Any,
    path: str,
    convert: Callable[[Any, str], Any],
    least: int = 0,
    most: int | None = None,
) -> list[Any]:
    """Convert each value with `convert`, and return a list; a list of exact values itself."""
    items = to_list(values, path, least, most)
    # A million bytes would take a million function calls, so that whole lists are checked first.
    if _are_exact(items, convert):
        return items
    if convert is to_byte and (made := _bytes_of(items)) is not None:
        return made
    try:
        return [convert(item, "") for item in items]
    except FieldError:
        return [convert(item, f"{path}[{i}]") for i, item in enumerate(items)]


def require_class(value: object, expected: type[Any], path: str) -> None:
    """Refuse a nested message of another class; subclasses are accepted."""
    if isinstance(value, expected):
        return
    if getattr(value, "_TYPE", None) == expected._TYPE:
        if isinstance(value, type):
            name = value.__name__
            problem = f"expected {expected._TYPE}, got the class {name} itself; write {name}()"
            raise FieldError(path, problem)
        raise FieldError(
            path, f"expected {expected._TYPE}, got a message of another class with that name"
        )
    _wrong(path, expected._TYPE, value)


def to_messages(
    values: Any, path: str, expected: type[Any], least: int = 0, most: int | None = None
) -> list[Any]:
    """Convert to a list of messages of this class, and check each of them."""
    items = to_list(values, path, least, most)
    checked = 0
    try:
        for item in items:
            if type(item) is not expected:
                require_class(item, expected, "")
            item._check()
            checked += 1
    except ValueError as error:
        raise with_prefix(error, f"{path}[{checked}]") from None
    return items


_ROSIDL_TYPES = {
    "bool": "boolean",
    "byte": "octet",
    "char": "uint8",
    "float32": "float",
    "float64": "double",
}


def _rosidl_type(type_: str) -> str:
    """A type as in the Python classes of rosidl: `sequence<double, 3>`."""
    element, bracket, size = type_.removesuffix("]").partition("[")
    base, bound, length = element.partition("<=")
    base = _ROSIDL_TYPES.get(base, base) + (f"<{length}>" if bound else "")
    if not bracket:
        return base
    if size.isdigit():
        return f"{base}[{size}]"
    return f"sequence<{base}, {size.removeprefix('<=')}>" if size else f"sequence<{base}>"


class Message(msgspec.Struct, kw_only=True, array_like=True, forbid_unknown_fields=True):
    """The base of every message class: a value with named, writable, default-initialised fields."""

    _TYPE: ClassVar[str] = ""
    """The full name: `geometry_msgs/msg/Point`."""
    _HASH: ClassVar[str] = ""
    """The RIHS01 hash of the type."""
    _FIELDS: ClassVar[tuple[tuple[str, str], ...]] = ()
    """The name and the type of each field, as in the definition."""
    _NESTED: ClassVar[Mapping[str, type[Any]]] = {}
    """The class of each field with messages; it may be based on another package's runtime."""
    _WIDTH: ClassVar[int] = 0
    """The number of fields."""
    _DECODES_EXACTLY: ClassVar[bool] = True
    """Whether msgspec decodes only values that `_check` would accept and leave as they are."""
    _fields_and_field_types: ClassVar[dict[str, str]] = {}
    _check_fields: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        cls._WIDTH = len(cls._FIELDS)
        cls._fields_and_field_types = {name: _rosidl_type(type_) for name, type_ in cls._FIELDS}
        _limit_decoded_values(cls)
        _take_arrays_when_set(cls)
        _name_slots_as_rosidl(cls)

    def _check(self) -> None:
        """Convert every field to its exact type, or raise FieldError."""

    @classmethod
    def _check_lines(cls, lines: Sequence[str]) -> Sequence[str]:
        """The lines of `_check` as this class compiles them; subclasses may change them."""
        return lines

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        """The name of each field and its type as in rosidl."""
        return cls._fields_and_field_types.copy()

    def __repr__(self) -> str:
        cls = type(self)
        values = (getattr(self, attribute) for attribute in cls.__struct_fields__)
        parts = (
            f"{name}={to_plain(value)!r}"
            for (name, _), value in zip(cls._FIELDS, values, strict=True)
        )
        package = cls.__module__.rpartition(".")[0]
        return f"{package}.{cls.__name__}({', '.join(parts)})".lstrip(".")

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        names = self.__struct_fields__
        return type(self)(**{name: deepcopy(getattr(self, name), memo) for name in names})

    __hash__ = None  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        names = self.__struct_fields__
        return all(are_equal(getattr(self, name), getattr(other, name)) for name in names)


def _name_slots_as_rosidl(cls: type[Message]) -> None:
    """Add an alias with a leading underscore for each field, as `__slots__` has in ROS."""
    slots = [f"_{name}" for name, _ in cls._FIELDS]
    for (name, _), slot in zip(cls._FIELDS, slots, strict=True):
        if not hasattr(cls, slot):
            setattr(cls, slot, cls.__dict__[attribute_of(cls, name)])
    setattr(cls, "__slots__", [*slots, "_check_fields"])  # noqa: B010 - unknown to type checkers


def attribute_of(cls: type[Message], name: str) -> str:
    """The attribute of a field: its name, or its name with `_` if that is reserved."""
    return name if name in cls.__dict__ else f"{name}_"


def _limited(name: str) -> Any:
    bits = int(name.removeprefix("u").removeprefix("int"))
    if name == "uint64":  # msgpack has no larger integers
        return Annotated[int, msgspec.Meta(ge=0)]
    low, high = (0, 2**bits) if name[0] == "u" else (-(2 ** (bits - 1)), 2 ** (bits - 1))
    return Annotated[int, msgspec.Meta(ge=low, le=high - 1)]


_LIMITED: dict[str, Any] = {
    f"{sign}int{bits}": _limited(f"{sign}int{bits}")
    for sign in ("", "u")
    for bits in (8, 16, 32, 64)
}
_LIMITED["char"] = _LIMITED["uint8"]
_LIMITED["byte"] = Annotated[bytes, msgspec.Meta(min_length=1, max_length=1)]
_LIMITED["byte[]"] = GenericAlias(list, (_LIMITED["byte"],))
"""The annotations with which msgspec refuses values that do not fit their field."""

_EXACT = frozenset({*_LIMITED, "float64"}).union(
    f"{type_}{end}" for type_ in ("bool", "string", "wstring") for end in ("", "[]")
)
"""Types whose decoded values need no check: not float32, which is rounded, nor an array of numbers,
which is decoded as bytes."""


def _limit_decoded_values(cls: type[Message]) -> None:
    """Let msgspec check ranges while it decodes, where that takes the place of `_check`.

    The check of a message in Python takes longer than decoding it.
    """
    annotations = cls.__annotations__
    cls._DECODES_EXACTLY = all(_decodes_exactly(cls, *field) for field in cls._FIELDS)
    for name, type_ in cls._FIELDS:
        if type_ in _LIMITED and (attribute := attribute_of(cls, name)) in annotations:
            annotations[attribute] = _LIMITED[type_]


def _decodes_exactly(cls: type[Message], name: str, type_: str) -> bool:
    nested = cls._NESTED.get(name)
    if nested is None:
        return type_ in _EXACT
    has_bound = "[" in type_ and not type_.endswith("[]")
    return not has_bound and getattr(nested, "_DECODES_EXACTLY", False)


def _take_arrays_when_set(cls: type[Message]) -> None:
    """Convert values to arrays when a numeric array field is set, as in ROS.

    An invalid value is stored unchanged; `_check` refuses it later with its complete path.
    """
    taken = []
    for name, type_ in cls._FIELDS:
        element, bracket, _ = type_.partition("[")
        if bracket and (array_class := ARRAY_CLASSES.get(element)):
            attribute = attribute_of(cls, name)
            slot = cls.__dict__[attribute]
            taken.append((slot.__get__, slot.__set__, array_class))
            setattr(cls, attribute, property(slot.__get__, _array_setter(slot, array_class)))
    if not taken:
        return

    def take(message: Message) -> None:
        for get, put, array_class in taken:
            values = get(message)
            if type(values) is not array_class:
                put(message, _array_if_it_fits(array_class, values))

    # msgspec calls this for every new message.
    cls.__post_init__ = take  # type: ignore[attr-defined]


def _array_setter(slot: Any, array_class: type[NumericArray[Any]]) -> Callable[[Any, Any], None]:
    put = slot.__set__

    def set_array(message: Any, values: Any) -> None:
        if type(values) is not array_class:
            values = _array_if_it_fits(array_class, values)
        put(message, values)

    return set_array


def _array_if_it_fits(array_class: type[NumericArray[Any]], values: Any) -> Any:
    try:
        return array_class.of(values, "")
    except FieldError:
        return values


def are_equal(one: Any, other: Any) -> bool:
    # numpy arrays compare element by element; other values of one type return a boolean.
    if type(one) is type(other) and (isinstance(one, array) or not hasattr(one, "tolist")):
        return bool(one == other)
    return bool(_numbers(one) == _numbers(other))


def _numbers(value: Any) -> Any:
    # The bytes before a check are equal to the array after it.
    return list(value) if isinstance(value, (bytes, bytearray)) else to_plain(value)


def to_plain(value: Any) -> Any:
    # Lists, arrays and numpy arrays of the same numbers are equal.
    if isinstance(value, array) or hasattr(value, "tolist"):
        return value.tolist()
    return list(value) if isinstance(value, tuple) else value


class _ConstantsMeta(msgspec.StructMeta):
    """Makes constants and defaults read-only, as in the classes of rosidl."""

    def __setattr__(cls, name: str, value: object) -> None:
        cls._refuse_constant(name)
        super().__setattr__(name, value)

    def __delattr__(cls, name: str) -> None:
        cls._refuse_constant(name)
        super().__delattr__(name)

    def _refuse_constant(cls, name: str) -> None:
        # Only constants and defaults begin with a capital.
        if name[:1].isupper() and name in cls.__dict__:
            raise AttributeError(f"{cls.__name__}.{name} is a constant and cannot be changed")


class MessageWithConstants(Message, kw_only=True, metaclass=_ConstantsMeta):
    """The base of messages with constants or defaults, which are read-only."""


class RenamingMeta(_ConstantsMeta):
    """Accepts a field whose name is a keyword as `from_` and as `from`."""

    def __init__(cls, *args: Any, **options: Any) -> None:
        super().__init__(*args)
        cls._RENAMED = {
            attribute[:-1]: attribute
            for attribute in cls.__struct_fields__
            if attribute.endswith("_")
        }
        for name, attribute in cls._RENAMED.items():
            if not hasattr(cls, name):
                setattr(cls, name, _alias(attribute))

    if not TYPE_CHECKING:

        def __call__(cls, /, *args, **values):
            return super().__call__(*args, **{cls._RENAMED.get(n, n): values[n] for n in values})


def _alias(attribute: str) -> property:
    getter = operator.attrgetter(attribute)
    return property(getter, lambda message, value: setattr(message, attribute, value))


class RenamedMessage(MessageWithConstants, kw_only=True, metaclass=RenamingMeta):
    """The base of messages with a field whose name is reserved."""


class _Namespace:
    _KIND: ClassVar[str]
    _TYPE: ClassVar[str]
    _HASH: ClassVar[str]
    _DEFINITION: ClassVar[str]

    def __new__(cls, *args: object, **values: object) -> Self:
        raise NotImplementedError(f"{cls._KIND} classes can not be instantiated")


RequestT = TypeVar("RequestT")
ResponseT = TypeVar("ResponseT")
GoalT = TypeVar("GoalT")
ResultT = TypeVar("ResultT")
FeedbackT = TypeVar("FeedbackT")

if TYPE_CHECKING:

    class _Typed(Generic[RequestT, ResponseT]):
        """Tells type checkers the message classes of a service; nested names do not."""

        @classmethod
        def _types(cls, request: RequestT, response: ResponseT) -> tuple[RequestT, ResponseT]: ...

    class _TypedAction(Generic[GoalT, ResultT, FeedbackT]):
        """Tells type checkers the message classes of an action."""

        @classmethod
        def _types(
            cls, goal: GoalT, result: ResultT, feedback: FeedbackT
        ) -> tuple[GoalT, ResultT, FeedbackT]: ...
else:

    class _Typed:
        # Generic would add public names and a longer MRO to every service class.
        __class_getitem__ = classmethod(lambda cls, messages: cls)

    _TypedAction = _Typed


class Service(_Namespace, _Typed[RequestT, ResponseT]):
    """The base of service classes, which only hold `Request`, `Response` and `Event`.

    Generated code has the message classes in brackets, for type checkers.
    """

    _KIND = "Service"


class Action(_Namespace, _TypedAction[GoalT, ResultT, FeedbackT]):
    """The base of action classes, which only hold `Goal`, `Result`, `Feedback` and `Impl`.

    Generated code has the message classes in brackets, for type checkers.
    """

    _KIND = "Action"
