"""The simulated physics: speed, agreement of its forms, and fits against recorded flights."""
