"""The harness: contenders in processes of their own, measured by turns, and what comes out."""
