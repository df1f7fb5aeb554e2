"""How well flights are predicted: from the truth with noise, and through the cameras."""
