"""A policy that learns while it plays the live rally."""

from app.modes.watch.learning.panel import LearningPanel

__all__ = ["LearningPanel"]
