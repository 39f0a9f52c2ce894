"""The checks of each lab, one module a lab.

Start with `lab1`. `common` has what several of them need: clients of the submission's services,
and the messages for the usual mistakes. A check uses only its `Trial`: no process, no file.
"""
