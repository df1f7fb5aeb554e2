"""The one training of a workspace, and what its runs have written so far."""
