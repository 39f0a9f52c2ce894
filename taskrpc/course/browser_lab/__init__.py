"""The labs in a browser tab: a static page with Pyodide, and the server of `taskrpc view --lab`.

`tab/` is the Python code that runs in the tab's worker, `static/` the page, `async_files/` the
starter files for browsers that cannot run rclpy. `site` puts the files of the page together,
`exercises` has its texts, `downloads` gets Pyodide, `server` serves the page.
"""
