from srvgen.stubs.nav_msgs.srv import *
