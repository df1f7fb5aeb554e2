"""Where a ball that the live chain missed can be looked into."""
