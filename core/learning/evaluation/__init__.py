"""Evaluation of policies: fixed balls, episode records, trivial policies."""
