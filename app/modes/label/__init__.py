"""The pieces of Label mode: what one browser labels, how it is shown, and how it is saved."""
