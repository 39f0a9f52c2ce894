from srvgen.stubs.lifecycle_msgs.msg import *
