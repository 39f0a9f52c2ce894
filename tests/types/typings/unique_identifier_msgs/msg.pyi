from srvgen.stubs.unique_identifier_msgs.msg import *
