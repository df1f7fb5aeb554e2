"""The event sensor: its settings, its pixels, noise and readout."""
