"""The base class of buffers: transforms messages, and converts them to other types."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from copy import deepcopy
from typing import Any, ClassVar

from rclpy.duration import Duration
from rclpy.time import Time
from std_msgs.msg import Header


class BufferInterface:
    """A buffer of transforms; subclasses look them up."""

    def __init__(self) -> None:
        self.registration = TransformRegistration()

    def transform(
        self,
        object_stamped: Any,
        target_frame: str,
        timeout: Duration = Duration(),  # noqa: B008 - ROS's default; durations never change
        new_type: Any = None,
    ) -> Any:
        """Return a message in another frame; the header gives its present frame and the time.

        Args:
            object_stamped: the message; `import tf2_geometry_msgs` registers types.
            target_frame: the frame of the result.
            timeout: how long to wait for the transform.
            new_type: the type to convert the result to.

        Raises:
            TransformException: there is no such transform.
            TypeException: no function is registered for the type.
        """
        do_transform = self.registration.get(type(object_stamped))
        header = object_stamped.header
        found = self.lookup_transform(target_frame, header.frame_id, header.stamp, timeout)
        result = do_transform(object_stamped, found)
        return result if new_type is None else convert(result, new_type)

    def transform_full(
        self,
        object_stamped: Any,
        target_frame: str,
        target_time: Time,
        fixed_frame: str,
        timeout: Duration = Duration(),  # noqa: B008
        new_type: Any = None,
    ) -> Any:
        """As `transform`, to another time; `fixed_frame` does not move between the two times."""
        do_transform = self.registration.get(type(object_stamped))
        header = object_stamped.header
        found = self.lookup_transform_full(
            target_frame, target_time, header.frame_id, header.stamp, fixed_frame, timeout
        )
        result = do_transform(object_stamped, found)
        return result if new_type is None else convert(result, new_type)

    def lookup_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Time,
        timeout: Duration = Duration(),  # noqa: B008
    ) -> Any:
        """The transform from the source frame to the target frame; subclasses find it."""
        raise NotImplementedException()

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: Time,
        source_frame: str,
        source_time: Time,
        fixed_frame: str,
        timeout: Duration = Duration(),  # noqa: B008
    ) -> Any:
        """The transform from one frame and time to another; subclasses find it."""
        raise NotImplementedException()

    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Time,
        timeout: Duration = Duration(),  # noqa: B008
    ) -> bool:
        """Whether `lookup_transform` finds the transform; subclasses decide."""
        raise NotImplementedException()

    def can_transform_full(
        self,
        target_frame: str,
        target_time: Time,
        source_frame: str,
        source_time: Time,
        fixed_frame: str,
        timeout: Duration = Duration(),  # noqa: B008
    ) -> bool:
        """Whether `lookup_transform_full` finds the transform; subclasses decide."""
        raise NotImplementedException()


def Stamped(obj: Any, stamp: Any, frame_id: str) -> Any:
    """The object itself, with a header."""
    obj.header = Header(frame_id=frame_id, stamp=stamp)
    return obj


class TypeException(Exception):
    """No function is registered for a type."""

    def __init__(self, errstr: str) -> None:
        super().__init__(errstr)
        self.errstr = errstr


class NotImplementedException(Exception):
    """A subclass of BufferInterface does not implement a method."""

    def __init__(self) -> None:
        self.errstr = "CanTransform or LookupTransform not implemented"
        super().__init__(self.errstr)


def _registered(
    functions: dict[Any, Callable[..., Any]], key: Hashable, advice: str = ""
) -> Callable[..., Any]:
    if key not in functions:
        raise TypeException(f"Type {key} is not loaded or supported{advice}")
    return functions[key]


def _knows(functions: dict[Any, Callable[..., Any]], package: str) -> bool:
    return any(getattr(key, "__module__", "").startswith(f"{package}.") for key in functions)


def _missing_import(functions: dict[Any, Callable[..., Any]], key: type) -> str:
    """Advice to import the package that registers the types of the same package as `key`."""
    package = key.__module__.partition(".")[0]
    module = {"geometry_msgs": "tf2_geometry_msgs", "sensor_msgs": "tf2_sensor_msgs"}.get(package)
    if module is None or _knows(functions, package):
        return ""
    return f"; `import {module}` registers types of {package}"


class TransformRegistration:
    """The functions that transform messages, by type; one table for the whole program."""

    _transforms: ClassVar[dict[Any, Callable[..., Any]]] = {}

    def print_me(self) -> None:
        """Print the table."""
        print(self._transforms)

    def add(self, key: type, callback: Callable[[Any, Any], Any]) -> None:
        """Register a function, which gets the message and a TransformStamped."""
        self._transforms[key] = callback

    def get(self, key: type) -> Callable[[Any, Any], Any]:
        """The function for a type. Raises TypeException."""
        return _registered(self._transforms, key, _missing_import(self._transforms, key))


class ConvertRegistration:
    """The functions that convert objects to and from messages; one table for the whole program."""

    _to_msg: ClassVar[dict[Any, Callable[..., Any]]] = {}
    _from_msg: ClassVar[dict[Any, Callable[..., Any]]] = {}
    _convert: ClassVar[dict[Any, Callable[..., Any]]] = {}

    def add_from_msg(self, key: type, callback: Callable[[Any], Any]) -> None:
        """Register a function that makes objects of a type from messages."""
        self._from_msg[key] = callback

    def add_to_msg(self, key: type, callback: Callable[[Any], Any]) -> None:
        """Register a function that makes messages from objects of a type."""
        self._to_msg[key] = callback

    def add_convert(self, key: tuple[type, type], callback: Callable[[Any], Any]) -> None:
        """Register a function that converts the first type to the second."""
        self._convert[key] = callback

    def get_from_msg(self, key: type) -> Callable[[Any], Any]:
        """The function that makes objects of a type. Raises TypeException."""
        return _registered(self._from_msg, key)

    def get_to_msg(self, key: type) -> Callable[[Any], Any]:
        """The function that makes messages from a type. Raises TypeException."""
        return _registered(self._to_msg, key)

    def get_convert(self, key: tuple[type, type]) -> Callable[[Any], Any]:
        """The function that converts the first type to the second. Raises TypeException."""
        return _registered(self._convert, key)


def convert(a: Any, b_type: Any) -> Any:
    """The object as another type: by a registered function, as a copy, or through a message."""
    registration = ConvertRegistration()
    try:
        direct = registration.get_convert((type(a), b_type))
    except TypeException:
        if type(a) is b_type:
            return deepcopy(a)
        return registration.get_from_msg(b_type)(registration.get_to_msg(type(a))(a))
    return direct(a)
