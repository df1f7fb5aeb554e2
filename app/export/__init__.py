"""Exports: one file per format. Pure functions from an open recording, or a run, to files; no viser."""
