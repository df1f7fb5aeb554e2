"""From a prediction to a racket command: the built-in controller, trained policies, the player."""
