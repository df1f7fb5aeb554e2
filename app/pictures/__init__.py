"""Pictures as indexed colours: events, detector stages, and the PNG that the browser gets. Pure functions, no viser."""
