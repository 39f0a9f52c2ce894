"""What several commands need: exit codes, argparse in ros2's manner, values, and who is there.

Start with `command`, which begins and ends every command. No command is defined here."""
