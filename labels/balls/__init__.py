"""The balls of all recordings as one table: every flight, bounce, stroke and net touch, with what is known of it."""
