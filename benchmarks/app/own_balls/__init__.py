"""A set of recordings of one's own, scored against what people labelled in it."""
