"""Training runs: seeds, files, control, summary."""
