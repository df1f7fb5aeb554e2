"""The policy's map in Train: computed off the loop, drawn, and put into words."""
