"""Simulated worlds, and whole balls through perception inside one process."""
