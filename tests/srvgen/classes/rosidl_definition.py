"""A message with fields of many kinds, for tests of the classes for ROS programs."""

from __future__ import annotations

import srvgen

INNER = f"\n{'=' * 80}\nMSG: rosidl_msgs/msg/Inner\nfloat64 x\nfloat64 y 1.0\n"
FIELDS = """
bool flag
byte raw
int8 small
uint16 count
float32 single
float64 double
string text
string<=5 short
Inner inner
float32[3] singles
uint8[2] bytes
bool[2] flags
int64[<=3] longs
float32[] ranges
string[] names
Inner[] inners
int32 THREE=3
"""


def define(fields: str = FIELDS, name: str = "rosidl_msgs/msg/Everything"):
    return srvgen.define(name, fields + INNER)
