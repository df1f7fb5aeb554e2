"""Training runs as a process lives them: seeds, files on disk, control, summary."""
