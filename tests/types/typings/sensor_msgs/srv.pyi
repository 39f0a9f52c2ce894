from srvgen.stubs.sensor_msgs.srv import *
