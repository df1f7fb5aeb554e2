"""Work off the loop: jobs with progress, and workers for which only the newest request counts."""
