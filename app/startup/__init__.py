"""Preparation of a first start: compiling and the demo recording in child processes, with progress."""
