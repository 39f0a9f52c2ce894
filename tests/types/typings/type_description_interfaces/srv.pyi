from srvgen.stubs.type_description_interfaces.srv import *
