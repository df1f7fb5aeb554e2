"""What labels are good for: files for other tools, and the score of a detector."""
