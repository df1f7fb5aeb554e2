"""F-E Fusion without its neural field: the centroid of one cluster of events."""
