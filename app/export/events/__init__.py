"""Events and truth in the formats of others: tables, DSEC, EVT3."""
