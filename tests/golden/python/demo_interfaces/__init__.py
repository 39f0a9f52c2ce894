"""The interfaces of demo_interfaces; by srvgen."""
