from srvgen.stubs.my_robot_interfaces.srv import *
