"""What the first label of a browser waits for: the name of who labels, and a recording that stays."""
