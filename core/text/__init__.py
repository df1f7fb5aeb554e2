"""Text from files: made fit to be shown, and read as JSON or TOML within bounds."""
