"""Speed and exactness of the detectors, and how good they are on simulated streams."""
