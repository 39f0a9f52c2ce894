from srvgen.stubs.service_msgs.msg import *
