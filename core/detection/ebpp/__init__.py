"""EBPP: a surface that every event updates, and a circular Hough transform of it."""
