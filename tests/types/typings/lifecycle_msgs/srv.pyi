from srvgen.stubs.lifecycle_msgs.srv import *
