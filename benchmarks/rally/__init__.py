"""Whole rallies: returns through perception, every scene, and recorded ball states."""
