"""Speed of the simulated event cameras, and the sensor held against brute force."""
