"""`package.xml` names what the programs of a package import."""

from taskrpc.ros.colcon.manifest import needs_of


def test_needs_are_ros_packages_rosdep_keys_and_unknown_modules():
    imported = {"os", "rclpy", "std_srvs", "numpy", "common", "mystery"}
    needs = needs_of(imported, {"std_srvs"}, {"common"})
    assert needs == (["python3-numpy", "rclpy", "std_srvs"], ["mystery"])
