from srvgen.stubs.type_description_interfaces.msg import *
