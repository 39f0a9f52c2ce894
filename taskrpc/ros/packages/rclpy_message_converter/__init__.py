"""Messages as dicts and JSON, with the functions of the package `rclpy_message_converter`.

`message_converter` has dicts, `json_message_converter` JSON. Only programs import this package.
"""
