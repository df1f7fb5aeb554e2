"""The seeds of a run side by side: their last evaluations, and the mean with its interval."""
