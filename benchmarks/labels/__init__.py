"""Trials of the labelling figures: durability, assistance, exchange; small counts in tests, large ones in benches."""
