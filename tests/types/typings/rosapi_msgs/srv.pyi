from srvgen.stubs.rosapi_msgs.srv import *
