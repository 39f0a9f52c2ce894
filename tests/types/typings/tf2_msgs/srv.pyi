from srvgen.stubs.tf2_msgs.srv import *
