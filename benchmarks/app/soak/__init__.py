"""The app under load for long: browsers watch, label and train while its memory, threads and files are counted."""
