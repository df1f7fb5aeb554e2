"""Automatic tuning in Tune: what is asked for, the process that searches, and what it found."""
