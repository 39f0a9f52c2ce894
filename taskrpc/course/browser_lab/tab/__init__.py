"""What runs in the worker of a browser tab, under Pyodide: programs, their checks, and the robot.

Start with `session`, which does what the page asks for. `threads` gives the tab threads, `programs`
runs the student's programs, `trial` carries out checks, and `robot` runs the task server. Nothing
here uses sockets, files of the disk or processes: a tab has none.
"""
