"""The browser app and the command line.

It composes what `core` and `labels` compute and is the only place that knows viser.
"""
