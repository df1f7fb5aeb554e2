"""Text: made fit to be shown, read as JSON or TOML within bounds, and written as tables of pages."""
