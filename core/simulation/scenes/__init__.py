"""What cameras look at: light, background, shading, the robot's racket, flicker."""
