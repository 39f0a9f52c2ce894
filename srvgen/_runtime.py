"""What generated message classes stand on: base classes, arrays, and the checks of each field.

`srvgen generate` copies this file into every package that it writes, so that a generated package
needs msgspec and nothing else; therefore only the standard library and msgspec are imported.
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
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NoReturn, Self, TypeVar

import msgspec


class FieldError(ValueError):
    """A field holds what its type does not allow.

    Attributes:
        path: where, from the message that was checked: `goal.position.x`, `ranges[3]`.
        problem: what was expected and what came.
    """

    def __init__(self, path: str, problem: str) -> None:
        super().__init__(path, problem)
        self.path = path
        self.problem = problem

    def __str__(self) -> str:
        return f"{self.path}: {self.problem}" if self.path else self.problem


def with_prefix(error: ValueError, name: str) -> FieldError:
    """The same error seen from the message that has the faulty one in its field `name`."""
    # The error may come from another package's copy of this file: only its attributes are known.
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
"""What packing a float raises for a value that is none, or is too large."""


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
    """How to pack and unpack this many float32 at once: at a quarter of the price of each alone."""
    layout = struct.Struct(f"<{count}f")
    return layout.pack, layout.unpack


def to_boolean(value: object, path: str) -> bool:
    """True or False; 0, 1 and numpy's booleans count."""
    if isinstance(value, int) and value in (0, 1):
        return bool(value)
    if type(value).__module__ == "numpy" and type(value).__name__ in ("bool", "bool_"):
        return bool(value)
    _wrong(path, "true or false", value)


def to_byte(value: object, path: str) -> bytes:
    """One byte as `bytes` of length 1, from that or from 0..255."""
    if isinstance(value, (bytes, bytearray)):
        if len(value) == 1:
            return bytes(value)
        _wrong(path, "one byte", value)
    return bytes((to_uint8(value, path),))


def to_text(value: object, path: str, bound: int | None = None) -> str:
    """A string that UTF-8 can carry, of at most `bound` characters."""
    if not isinstance(value, str):
        _wrong(path, "string", value)
    text = str.__str__(value)
    if bound is not None and len(text) > bound:
        raise FieldError(path, f"expected at most {bound} characters, got {len(text)}")
    try:
        text.encode()
    except UnicodeEncodeError as error:
        problem = f"expected text that UTF-8 can carry, got a lone surrogate at {error.start}"
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
        # Python 3.11's own cannot be subscripted.
        __slots__ = ()
        __class_getitem__ = classmethod(GenericAlias)


class NumericArray(_Elements[Number]):
    """A sequence of one numeric type; compares equal to a list of the same numbers.

    Takes any iterable of numbers; `bytes` and `bytearray` are raw little-endian elements.

    Raises:
        FieldError: an element does not fit; its path is the index, `[3]`.
    """

    __slots__ = ()
    _CODE: ClassVar[str]
    _SIZE: ClassVar[int]
    _CONVERT: ClassVar[Callable[[Any, str], float]]

    if TYPE_CHECKING:  # as a field it takes any iterable of numbers

        def __get__(self, instance: object, owner: type) -> Self: ...
        def __set__(self, instance: object, value: Iterable[Number]) -> None: ...

    def __new__(cls, values: Iterable[Number] = ()) -> Self:
        return cls.of(values, "")

    @classmethod
    def field(cls, default: int | tuple[float, ...] = ()) -> Any:
        """A field's default: these elements, or this many zeros."""
        values = bytes(default * cls._SIZE) if isinstance(default, int) else default
        return msgspec.field(default_factory=partial(_new, cls, cls._CODE, values))

    @classmethod
    def of(cls, values: Any, path: str, least: int = 0, most: int | None = None) -> Self:
        """The values as this array, of `least` to `most` elements; FieldError with the path."""
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
            # A large image would cost forty times as much by way of bytes, which are a second copy.
            is_plain = view.format in _KINDS and view.c_contiguous and view.nbytes > 0
            made.frombytes(view.cast("B") if is_plain else view.tobytes())
            return made
        # numpy's own ravel and tolist know the formats (float16, '>i4') that memoryview does not.
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
            # array() turns what float32 cannot hold into infinity without a word.
            return _new(cls, cls._CODE, struct.pack(f"={len(items)}f", *items))
        except (TypeError, ValueError, OverflowError, struct.error):
            exact = [cls._CONVERT(item, f"{path}[{i}]") for i, item in enumerate(items)]
        return _new(cls, cls._CODE, exact)

    def little_endian(self) -> memoryview:
        """The elements' bytes as messages carry them."""
        if not _SWAPPED:
            return memoryview(self)
        swapped = self.__copy__()
        swapped.byteswap()
        return memoryview(swapped)

    if not TYPE_CHECKING:  # array's own gives a plain array, which equals no list

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
        # As ROS prints it: there, too, programs see a plain array.
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

# Messages carry arrays as raw bytes, which msgspec decodes without calling Python; `_check` makes
# the arrays. Type checkers are told what a program sees.
if TYPE_CHECKING:
    Ints = NumericArray[int]
    Floats = NumericArray[float]

    class Byte:
        """A field that reads as `bytes` of length 1 and takes 0..255 too."""

        def __get__(self, instance: object, owner: type) -> bytes: ...
        def __set__(self, instance: object, value: bytes | int) -> None: ...
else:
    Byte = Ints = Floats = bytes


def byte(value: bytes) -> Any:
    """The default of a `byte` field, whose declared type is not what is set."""
    return value


def encode_hook(value: Any) -> memoryview:
    """What msgspec's encoders must be given as `enc_hook`; any package's copy serves them all."""
    try:
        view: memoryview = value.little_endian()
    except AttributeError:
        raise NotImplementedError(f"a message cannot carry {short_repr(value)}") from None
    return view


def check_length(values: Sized, path: str, least: int, most: int | None) -> None:
    """Refuse fewer than `least` or more than `most` elements."""
    count = len(values)
    if count < least or (most is not None and count > most):
        bound, plural = least if least == most else f"at most {most}", "" if most == 1 else "s"
        raise FieldError(path, f"expected {bound} element{plural}, got {count}")


def to_list(values: Any, path: str, least: int = 0, most: int | None = None) -> list[Any]:
    """The values as a list (the same one, if it is one) of `least` to `most` elements."""
    if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, Iterable):
        _wrong(path, "a list", values)
    items = values if type(values) is list else list(values)
    check_length(items, path, least, most)
    return items


def to_items(
    values: Any,
    path: str,
    convert: Callable[[Any, str], Any],
    least: int = 0,
    most: int | None = None,
) -> list[Any]:
    """A list of what `convert` makes of each value."""
    items = to_list(values, path, least, most)
    try:
        return [convert(item, "") for item in items]
    except FieldError:
        return [convert(item, f"{path}[{i}]") for i, item in enumerate(items)]


def require_class(value: object, expected: type[Any], path: str) -> None:
    """Refuse a nested message of another class; subclasses only add checks."""
    if isinstance(value, expected):
        return
    if getattr(value, "_TYPE", None) == expected._TYPE:
        raise FieldError(path, f"expected {expected._TYPE}, got one of another class of that name")
    _wrong(path, expected._TYPE, value)


def to_messages(
    values: Any, path: str, expected: type[Any], least: int = 0, most: int | None = None
) -> list[Any]:
    """A list of messages of exactly this class, each of them checked."""
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
    """A definition's type as rosidl's Python classes spell it: `sequence<double, 3>`."""
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
    _HASH: ClassVar[str] = ""
    _FIELDS: ClassVar[tuple[tuple[str, str], ...]] = ()
    # Nested classes may stand on another package's copy of this file.
    _NESTED: ClassVar[Mapping[str, type[Any]]] = {}
    _WIDTH: ClassVar[int] = 0
    _fields_and_field_types: ClassVar[dict[str, str]] = {}
    _check_fields: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        cls._WIDTH = len(cls._FIELDS)
        cls._fields_and_field_types = {name: _rosidl_type(type_) for name, type_ in cls._FIELDS}
        _take_arrays_when_set(cls)
        _name_slots_as_rosidl(cls)

    def _check(self) -> None:
        """Bring every field to its exact type, or raise FieldError."""

    @classmethod
    def _check_lines(cls, lines: Sequence[str]) -> Sequence[str]:
        """The rendered lines of a `_check`, as this class compiles them."""
        return lines

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        """Each field's name and its type in rosidl's spelling."""
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
    """Give fields a second name with an underscore in front: `__slots__` has these in ROS."""
    slots = [f"_{name}" for name, _ in cls._FIELDS]
    for (name, _), slot in zip(cls._FIELDS, slots, strict=True):
        if not hasattr(cls, slot):
            setattr(cls, slot, cls.__dict__[attribute_of(cls, name)])
    setattr(cls, "__slots__", [*slots, "_check_fields"])  # noqa: B010 - unknown to type checkers


def attribute_of(cls: type[Message], name: str) -> str:
    """A field's attribute: its name, unless Python or we need that."""
    return name if name in cls.__dict__ else f"{name}_"


def _take_arrays_when_set(cls: type[Message]) -> None:
    """Have fields of numbers hold arrays from the moment when they are set, as programs see in ROS.

    What does not fit stays as it is until the check, which knows the whole path to it.
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

    # What msgspec calls whenever a message was made.
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
    # numpy's arrays would be compared element by element; all else of one type has an answer.
    if type(one) is type(other) and (isinstance(one, array) or not hasattr(one, "tolist")):
        return bool(one == other)
    return bool(_numbers(one) == _numbers(other))


def _numbers(value: Any) -> Any:
    # Bytes before and the array after a check are equal.
    return list(value) if isinstance(value, (bytes, bytearray)) else to_plain(value)


def to_plain(value: Any) -> Any:
    # Lists before and after a check, arrays and numpy's arrays of the same numbers are equal.
    if isinstance(value, array) or hasattr(value, "tolist"):
        return value.tolist()
    return list(value) if isinstance(value, tuple) else value


class _ConstantsMeta(msgspec.StructMeta):
    """Keeps constants and defaults as the definition has them, as rosidl's classes do."""

    def __setattr__(cls, name: str, value: object) -> None:
        cls._refuse_constant(name)
        super().__setattr__(name, value)

    def __delattr__(cls, name: str) -> None:
        cls._refuse_constant(name)
        super().__delattr__(name)

    def _refuse_constant(cls, name: str) -> None:
        # Nothing else in a message class begins with a capital.
        if name[:1].isupper() and name in cls.__dict__:
            raise AttributeError(f"{cls.__name__}.{name} is a constant and cannot be changed")


class MessageWithConstants(Message, kw_only=True, metaclass=_ConstantsMeta):
    """The base of messages that have constants or defaults, which nobody can set."""


class RenamingMeta(_ConstantsMeta):
    """Lets a keyword field be written both as `from_` and as `from`."""

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
    """The base of messages with a field whose name Python keeps for itself."""


class _Namespace:
    _KIND: ClassVar[str]
    _TYPE: ClassVar[str]
    _HASH: ClassVar[str]
    _DEFINITION: ClassVar[str]

    def __new__(cls, *args: object, **values: object) -> Self:
        raise NotImplementedError(f"{cls._KIND} classes can not be instantiated")


RequestT = TypeVar("RequestT")
ResponseT = TypeVar("ResponseT")

if TYPE_CHECKING:

    class _Typed(Generic[RequestT, ResponseT]):
        """Gives type checkers a service's messages, which they cannot find by nested names."""

        @classmethod
        def _types(cls, request: RequestT, response: ResponseT) -> tuple[RequestT, ResponseT]: ...
else:

    class _Typed:
        # The real Generic would give every service class a longer MRO and public names of its own.
        __class_getitem__ = classmethod(lambda cls, messages: cls)


class Service(_Namespace, _Typed[RequestT, ResponseT]):
    """The base of service classes, which only hold `Request`, `Response` and `Event`.

    Generated code names the messages in brackets, for type checkers.
    """

    _KIND = "Service"


class Action(_Namespace):
    """The base of action classes, which only hold `Goal`, `Result`, `Feedback` and `Impl`."""

    _KIND = "Action"
