"""Training from the app: what may be started, the one process that trains, and what its files tell."""
