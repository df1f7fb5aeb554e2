"""A rally over time: what the chain saw at any moment, live or recorded, and how it is kept."""
