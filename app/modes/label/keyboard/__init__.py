"""The keys of Label: which there are, and those that wait for what they judge."""
