"""The engine for Zenoh, in the wire format of ROS 2's rmw_zenoh.

Start with `zenoh_engine`. The formats are pure: `keys` are the key expressions, `tokens` describe
nodes and their services and topics, `attachment` goes with each message, `graph` collects the
tokens. `configuration` reads the settings. `session` opens Zenoh; `services` and `topics` are
the native ones. Only these three and `zenoh_engine` import Zenoh's library.
"""
