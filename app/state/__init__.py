"""State of one browser as one frozen value, and the commands that change it."""
