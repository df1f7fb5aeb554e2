"""The paper's perception and its comparisons, on simulated recordings after its own."""
