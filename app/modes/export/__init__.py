"""Export: its mode, its panels, the one export of a workspace and what it freezes."""
