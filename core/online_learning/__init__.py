"""Online learning: a policy that learns from the strokes that it plays in a live rally."""
