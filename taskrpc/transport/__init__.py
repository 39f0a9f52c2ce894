"""How calls travel: the seam (`base`), and behind it TCP and memory."""
