"""Benchmarks of the app, and scripted users of it; the only place that imports playwright."""
