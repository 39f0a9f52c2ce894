"""Message classes for programs that are written for ROS; `loader.make_ros_classes` turns them on.

They also have `SLOT_TYPES`, return arrays of fixed length as numpy arrays if numpy is installed,
and can check values when fields are set: with `check_fields=True` for one message, or with
ROS_PYTHON_CHECK_FIELDS=1 in the environment for all.
"""

from __future__ import annotations

import os
import re
from array import array
from collections.abc import Callable, Sequence, Set
from copy import deepcopy
from functools import cache
from types import ModuleType
from typing import TYPE_CHECKING, Any, ClassVar

from .. import _runtime
from .._runtime import Message, NumericArray
from .slot_types import (
    INTEGER_TYPES,
    AbstractGenericString,
    AbstractNestableType,
    AbstractNestedType,
    AbstractType,
    Array,
    BasicType,
    NamespacedType,
    slot_type,
)

Validator = Callable[[Any], str | None]
"""Returns the error text that follows the name of the field, or None for a valid value."""


def runtime() -> ModuleType:
    """A copy of `_runtime` with the base class of this module."""
    module = ModuleType(_runtime.__name__)
    module.__dict__.update(vars(_runtime))
    for name in ("Message", "MessageWithConstants", "RenamedMessage"):
        setattr(module, name, RosMessage)
    return module


_made = type(Message).__call__


class _RosMessageMeta(_runtime.RenamingMeta):
    """Makes messages of the class, or of its variant with the other setting of checks.

    A subclass in a program may have attributes and an `__init__` of its own, which msgspec refuses.
    """

    if not TYPE_CHECKING:

        def __new__(meta, name, bases, names, **options):
            if "_TYPE" in names or "_ORIGINAL" in names or "SLOT_TYPES" in names:
                return super().__new__(meta, name, bases, names, **options)
            init = names.pop("__init__", None)
            names.pop("__annotations__", None)  # they would become fields
            made = super().__new__(
                meta, name, bases, names, **{"dict": True, "gc": True, **options}
            )
            if init is not None:
                _set(made, "__init__", init)
                _set(made, "_HAS_INIT", True)
            return made

        def __call__(cls, /, *args, **values):
            if cls._HAS_INIT:
                message = _made(cls)
                cls.__init__(message, *args, **values)
                return message
            if "check_fields" in values:
                cls = _with_checks(cls, bool(values.pop("check_fields")))
            if cls._CHECKS:
                _validate_all(cls, values)
            for name in cls._ARRAYS.keys() & values.keys():
                values[name] = _array_as_in_ros(*cls._ARRAYS[name], values[name])
            if cls._RENAMED:
                return super().__call__(*args, **values)
            return _made(cls, *args, **values)


class RosMessage(Message, kw_only=True, metaclass=_RosMessageMeta):
    """The base of message classes in programs for ROS."""

    SLOT_TYPES: ClassVar[tuple[AbstractType, ...]] = ()
    """The type of each field, in order."""

    _NAMES: ClassVar[frozenset[str]] = frozenset()
    """The names under which a program may set fields."""
    _LENIENT: ClassVar[dict[str, Any]] = {}
    """Descriptors of the fields that take any value, by attribute."""
    _STRICT: ClassVar[dict[str, Any]] = {}
    """The same descriptors with checks."""
    _HAS_INIT: ClassVar[bool] = False
    """Whether it is a subclass in a program, with an `__init__` of its own."""
    _ARRAYS: ClassVar[dict[str, tuple[type[NumericArray[Any]], bool]]] = {}
    """The class of each numeric array and whether its length is fixed, by name and attribute."""
    _CHECKS: ClassVar[bool] = False
    """Whether the fields are checked."""
    _ORIGINAL: ClassVar[Any] = None
    """The class that programs see; a variant refers to its original."""
    _VARIANT: ClassVar[Any] = None
    _VALIDATORS: ClassVar[dict[str, tuple[str, Validator]]] = {}
    """The name and the validator of each field, by its name and by its attribute."""

    def __init_subclass__(cls) -> None:
        if "_ORIGINAL" in cls.__dict__:  # a variant
            _set_checks(cls, checks=not cls._ORIGINAL._CHECKS)
            return
        if cls._ORIGINAL is not None:  # a subclass in a program, with the fields of its base
            return
        attributes = [_runtime.attribute_of(cls, name) for name, _ in cls._FIELDS]
        slots = {name: cls.__dict__[name] for name in attributes}
        super().__init_subclass__()
        cls._ORIGINAL = cls
        types = tuple(slot_type(type_, cls._NESTED.get(name)) for name, type_ in cls._FIELDS)
        _set(cls, "SLOT_TYPES", types)
        cls._NAMES = frozenset({*attributes, *(name for name, _ in cls._FIELDS)})
        lenient, strict, validators, arrays = {}, {}, {}, {}
        for (name, text), attribute, type_ in zip(cls._FIELDS, attributes, types, strict=True):
            found = cls.__dict__[attribute]
            element, bracket, _ = text.partition("[")
            if bracket and (array_class := _runtime.ARRAY_CLASSES.get(element)):
                arrays[name] = arrays[attribute] = array_class, _is_fixed_and_numeric(type_)
                found = property(found.__get__, _array_setter(*arrays[name], found))
            if _is_fixed_and_numeric(type_):
                found = property(_numpy_getter(slots[attribute]), found.__set__)
            validator = _validator(type_, cls._NESTED.get(name))
            lenient[attribute] = found
            strict[attribute] = property(found.__get__, _checked_setter(name, validator, found))
            validators[name] = validators[attribute] = (name, validator)
        cls._LENIENT, cls._STRICT, cls._VALIDATORS = lenient, strict, validators
        cls._ARRAYS = arrays
        _set_checks(cls, checks=os.environ.get("ROS_PYTHON_CHECK_FIELDS") == "1")

    @classmethod
    def _check_lines(cls, lines: Sequence[str]) -> Sequence[str]:
        # Checks read the stored arrays, not their numpy views.

        def stored(match: re.Match[str]) -> str:
            name = f"_{match[2]}"
            return match[1] + name if isinstance(getattr(cls, name, None), property) else match[0]

        return [re.sub(r"^( *(\w+)_ = self\.)\w+$", stored, line) for line in lines]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, self._ORIGINAL):
            return NotImplemented
        names = self.__struct_fields__
        return all(_runtime.are_equal(getattr(self, n), getattr(other, n)) for n in names)

    __hash__ = None

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:
        if not self._HAS_INIT:
            return super().__deepcopy__(memo)
        copied = _made(type(self))
        for name, value in [*_fields(self), *vars(self).items()]:
            setattr(copied, name, deepcopy(value, memo))
        return copied

    def __repr__(self) -> str:
        fields = zip(self._FIELDS, self.__struct_fields__, strict=True)
        parts = (f"{name}={_shown(getattr(self, attribute))}" for (name, _), attribute in fields)
        package = type(self).__module__.rpartition(".")[0]
        return f"{package}.{type(self).__name__}({', '.join(parts)})".lstrip(".")


def _is_checked(message: Any) -> bool:
    return bool(message._CHECKS)


def _enable_checks(message: Any, checks: object) -> None:
    message.__class__ = _with_checks(type(message), bool(checks))


def _array_setter(
    array_class: type[NumericArray[Any]], is_fixed: bool, found: Any
) -> Callable[[Any, Any], None]:
    put = found.__set__
    return lambda message, values: put(message, _array_as_in_ros(array_class, is_fixed, values))


def _array_as_in_ros(array_class: type[NumericArray[Any]], is_fixed: bool, values: Any) -> Any:
    """Convert to an array. For wrong elements, raise the error of real classes.

    These make arrays of numpy for a fixed length, and arrays of Python for any other.
    """
    if type(values) is array_class:
        return values
    try:
        return array_class.of(values, "")
    except _runtime.FieldError:
        if is_fixed and (numpy := _numpy()) is not None:
            numpy.array(values, dtype=array_class._CODE)
        else:
            array(array_class._CODE, values)
        return values  # refused when the message is sent


def _init(message: Any, **values: Any) -> None:
    """Set fields: what `super().__init__(...)` calls in a subclass of a program."""
    checks = values.pop("check_fields", None)
    made = (
        message._ORIGINAL(**values)
        if checks is None
        else message._ORIGINAL(check_fields=checks, **values)
    )
    for name, value in _fields(made):
        setattr(message, name, value)


def _fields(message: Any) -> list[tuple[str, Any]]:
    """The attribute of each field, and its value."""
    return [(name, getattr(message, name)) for name in message.__struct_fields__]


setattr(RosMessage, "_check_fields", property(_is_checked, _enable_checks))  # noqa: B010
setattr(RosMessage, "__init__", _init)  # noqa: B010 - msgspec refuses it in the class


def _set(cls: Any, name: str, value: object) -> None:
    type.__setattr__(cls, name, value)  # constants refuse to be set


def _set_checks(cls: Any, *, checks: bool) -> None:
    """Switch the checks of the class on or off."""
    for attribute, descriptor in (cls._STRICT if checks else cls._LENIENT).items():
        _set(cls, attribute, descriptor)
    _set(cls, "_CHECKS", checks)


def _with_checks(cls: Any, checks: bool) -> Any:
    """The class or its variant, depending on the wanted checks."""
    known = cls._ORIGINAL
    if known._CHECKS is checks:
        return known
    if known._VARIANT is None:
        names = {"__module__": known.__module__, "_ORIGINAL": known}
        _set(known, "_VARIANT", type(known)(known.__name__, (known,), names))
    return known._VARIANT


def _is_fixed_and_numeric(type_: AbstractType) -> bool:
    return isinstance(type_, Array) and _array_code(type_.value_type) != ""


@cache
def _numpy() -> Any:
    """numpy if it is installed; imported when a program first reads an array of fixed length."""
    try:
        import numpy
    except ImportError:
        return None
    return numpy


def _numpy_getter(slot: Any) -> Callable[[Any], Any]:
    get = slot.__get__

    def get_array(message: Any) -> Any:
        values = get(message)
        numpy = _numpy()
        if numpy is None or not isinstance(values, NumericArray):
            return values
        # A view: changes of the array change the message.
        return numpy.frombuffer(values, dtype=values._CODE) if values else numpy.array([])

    return get_array


def _shown(value: Any) -> str:
    numpy_array = type(value).__module__ == "numpy" and hasattr(value, "tolist")
    return repr(value if numpy_array else _runtime.to_plain(value))


# --- checks ---------------------------------------------------------------------------------------


def _checked_setter(name: str, validator: Validator, descriptor: Any) -> Callable[[Any, Any], None]:
    put = descriptor.__set__

    def set_checked(message: Any, value: Any) -> None:
        _require_valid(name, validator, value)
        put(message, value)

    return set_checked


def _validate_all(cls: Any, values: dict[str, Any]) -> None:
    """Check the arguments of a constructor.

    Not in `__post_init__`: msgspec calls that for received messages too, whose arrays are bytes.
    """
    if odd := sorted(values.keys() - cls._NAMES):
        raise AssertionError(f"Invalid arguments passed to constructor: {', '.join(odd)}")
    for key, value in values.items():
        name, validator = cls._VALIDATORS[key]
        _require_valid(name, validator, value)


def _require_valid(name: str, validator: Validator, value: Any) -> None:
    if (problem := validator(value)) is not None:
        raise AssertionError(f"The '{name}' {problem}")


def _validator(type_: AbstractType, nested: Any) -> Validator:
    if isinstance(type_, AbstractNestedType):
        return _array_validator(type_, nested)
    rule = _rule(type_, nested)

    def validator(value: Any) -> str | None:
        for fits, text in rule:
            if not fits(value):
                return f"field must be {text}"
        return None

    return validator


_Rule = list[tuple[Callable[[Any], bool], str]]


def _rule(type_: AbstractType, nested: Any) -> _Rule:
    """The checks of a single value, with ROS's text for each."""
    if isinstance(type_, NamespacedType):
        return [(_is_a(nested), f"a sub message of type '{nested.__name__}'")]
    if isinstance(type_, AbstractGenericString):
        most = getattr(type_, "maximum_size", None)
        if most is None:
            return [(_is_a(str), "of type 'str'")]
        short = f"string value not longer than {most}"
        return [(lambda value: isinstance(value, str) and len(value) <= most, short)]
    assert isinstance(type_, BasicType)
    name = type_.typename
    if name == "octet":
        one = "of type 'bytes' or 'ByteString' with length 1"
        return [(lambda value: isinstance(value, (bytes, bytearray)) and len(value) == 1, one)]
    python = _python_type(type_)
    rule: _Rule = [(_is_a(python), f"of type '{python.__name__}'")]
    if name in INTEGER_TYPES:
        low, high = _range(name)
        kind = "an unsigned integer" if low == 0 else "an integer"
        rule.append((lambda value: low <= value <= high, f"{kind} in [{low}, {high}]"))
    elif name == "float":
        text = f"a float in [-{_FLOAT}, {_FLOAT}]"
        rule.append((_is_float32, text))
    return rule


def _array_validator(type_: AbstractNestedType, nested: Any) -> Validator:
    element = type_.value_type
    fixed = type_.size if isinstance(type_, Array) else None
    most = getattr(type_, "maximum_size", None)
    elements = [(_is_a(_python_type(element, nested)), ""), *_rule(element, nested)]
    text = f"field must be a set or sequence{_with_length(fixed, most)} and each value of type "
    text += f"'{_python_type(element, nested).__name__}'{_and_in_range(element)}"
    code = _array_code(element)

    def fits(values: Any) -> bool:
        if isinstance(values, str) or not isinstance(values, (Sequence, Set)):
            return False
        count = len(values)
        if count != fixed if fixed is not None else most is not None and count > most:
            return False
        return all(fit(value) for value in values for fit, _ in elements)

    def validator(values: Any) -> str | None:
        if code and fixed is not None and hasattr(values, "dtype"):
            if values.dtype != code:
                name = _numpy().dtype(code).name
                return f"numpy.ndarray() must have the dtype of 'numpy.{name}'"
            return None if values.size == fixed else f"numpy.ndarray() must have a size of {fixed}"
        if code and fixed is None and hasattr(values, "typecode"):
            if values.typecode != code:
                return f"array.array() must have the type code of '{code}'"
            if most is not None and len(values) > most:
                return f"array.array() must have a size <= {most}"
            return None
        return None if fits(values) else text

    return validator


_FLOAT = 3.402823466e38
_DOUBLE = 1.7976931348623157e308
_ELEMENTS = {"float": "float32", "double": "float64"} | {
    name: name for name in INTEGER_TYPES if name in _runtime.ARRAY_CLASSES
}


def _array_code(type_: AbstractNestableType) -> str:
    """The type code of arrays of such elements, "" if they are lists."""
    name = _ELEMENTS.get(getattr(type_, "typename", ""))
    return "" if name is None else _runtime.ARRAY_CLASSES[name]._CODE


def _is_a(cls: Any) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, cls)


def _is_float32(value: float) -> bool:
    return not _FLOAT < abs(value) < float("inf")


def _python_type(type_: AbstractNestableType, nested: Any = None) -> type[Any]:
    if isinstance(type_, NamespacedType):
        found: type[Any] = nested
        return found
    if isinstance(type_, AbstractGenericString):
        return str
    name = getattr(type_, "typename", "")
    if name in INTEGER_TYPES:
        return int
    return {"boolean": bool, "octet": bytes}.get(name, float)


def _range(name: str) -> tuple[int, int]:
    bits = int(name.removeprefix("u").removeprefix("int"))
    return (0, 2**bits - 1) if name[0] == "u" else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


def _with_length(fixed: int | None, most: int | None) -> str:
    if fixed is not None:
        return f" with length {fixed}"
    return "" if most is None else f" with length <= {most}"


def _and_in_range(type_: AbstractNestableType) -> str:
    name = getattr(type_, "typename", "")
    if name in INTEGER_TYPES:
        low, high = _range(name)
        return f" and each {'unsigned ' * (low == 0)}integer in [{low}, {high}]"
    top = {"float": _FLOAT, "double": _DOUBLE}.get(name)
    return "" if top is None else f" and each {name} in [{-top:f}, {top:f}]"
