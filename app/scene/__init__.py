"""What stands in the 3D scene of one browser: arena, ball and trail, cameras. Handles only, no logic."""
