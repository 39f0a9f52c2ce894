"""Transforms of point clouds, with ROS's `tf2_sensor_msgs` functions; they need numpy.

Importing it registers `PointCloud2`, so that `Buffer.transform` takes it. The functions are in the
module of the same name. Points of `geometry_msgs` belong to `tf2_geometry_msgs`.
"""

from .tf2_sensor_msgs import do_transform_cloud, from_msg_msg, to_msg_msg, transform_points

__all__ = ["do_transform_cloud", "from_msg_msg", "to_msg_msg", "transform_points"]
