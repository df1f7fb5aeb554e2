"""What stands in the 3D scene of one browser: arena, ball, racket, predictions, landing spots, cameras."""
