"""Panels, one per file: each builds its controls once, sends commands, and shows the state it is given."""
