"""What would the paper's numbers take? A search over what the paper leaves open, and its claims where they fit."""
