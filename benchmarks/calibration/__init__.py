"""What calibration achieves, and what its errors do to positions in space."""
