"""What differs between Linux, macOS and Windows, except the socket options of TCP.

`folders` says where files go; `private_files` opens and writes files that only this user can read.
`file_locks` lets one process at a time hold a file. `process_state` asks the system about a
process, and `signals` ends one; `resources` says what this one may use. `terminal` reads keys, and
`os_errors` has the texts of errors.
"""

# A command needs few of these functions. The imports for all of them would take most of the time of
# `taskrpc --help`, so most functions import what they use.
