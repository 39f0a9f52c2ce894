from srvgen.stubs.sensor_msgs.msg import *
