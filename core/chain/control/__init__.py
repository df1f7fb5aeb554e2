"""From a prediction to a racket command: the built-in controller, the choice of the hit, the player."""
