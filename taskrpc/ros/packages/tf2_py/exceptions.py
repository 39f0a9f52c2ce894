"""The exceptions of transform lookups."""

from __future__ import annotations


class TransformException(Exception):
    """A transform cannot be given; the base class of the other exceptions."""


class ConnectivityException(TransformException):
    """The two frames are in different trees."""


class LookupException(TransformException):
    """A frame does not exist, or the frames form a loop."""


class ExtrapolationException(TransformException):
    """The requested time is outside the times that the buffer holds."""


class InvalidArgumentException(TransformException):
    """A frame name is empty or begins with a slash."""


class TimeoutException(TransformException):
    """The transform did not become available in time."""


for _each in (TransformException, *TransformException.__subclasses__()):
    _each.__module__ = "tf2"  # a traceback names the exception as on ROS, `tf2.LookupException`
