from srvgen.stubs.rosapi_msgs.msg import *
