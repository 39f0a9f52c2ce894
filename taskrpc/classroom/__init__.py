"""Thirty laptops and one robot: a lab's certificate, its accounts, and strings to join it with."""
