from srvgen.stubs.my_robot_interfaces.action import *
