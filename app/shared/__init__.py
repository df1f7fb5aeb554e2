"""Shared by all browsers: workspace, recordings, the live rally, trained policies."""
