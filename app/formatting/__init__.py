"""How things are said: shares, errors, and what the app's words mean."""
