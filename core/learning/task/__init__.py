"""The one-step task: environment, perception of the ball, reward, and episode backends."""
