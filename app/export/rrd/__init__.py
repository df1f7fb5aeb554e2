"""Recordings and training runs as Rerun files."""
