"""The refined detector: two arcs, both polarities, a circle that moves; one idea per file."""
