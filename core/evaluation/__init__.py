"""How good a detector is: matching against truth, precision, recall, pixel errors, benchmarks."""
