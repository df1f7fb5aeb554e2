"""What one browser has chosen as one frozen value, and the commands that make the next one of it."""
