"""Export of events and truth: CSV tables, DSEC, EVT3."""
