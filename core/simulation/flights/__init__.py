"""Ball paths as the simulated cameras follow them: arcs, traced flights, series of serves."""
