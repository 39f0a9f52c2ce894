"""The machinery behind rclpy's names: nothing here is a file of ROS.

`execution` runs callbacks, `parameters` and `graph` are what nodes know, `diagnostics` explains
what ROS 2 would do in silence. `bridge` is the only module that knows the background event loop."""
