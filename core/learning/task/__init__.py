"""The one-step task: environment, perception of the ball, reward, and where balls are played."""
