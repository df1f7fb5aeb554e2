"""Work off the loop: jobs with progress, and workers that serve only the newest request."""
