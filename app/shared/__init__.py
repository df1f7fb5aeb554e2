"""What all browsers of the app share: workspace, recordings, the live rally, trained policies."""
