"""Watch: what happened in a rally, live or recorded, and how it is told in figures."""
