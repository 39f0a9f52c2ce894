"""Programs that offer and call a service.

Run `add_two_ints_server` in one terminal and a client in another. They use `add_two_ints`.
Topics are in `demo_nodes_py.topics`.
"""
