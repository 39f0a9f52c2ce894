"""The robot's tasks: a durable priority queue, its worker, and the services in front of them."""
