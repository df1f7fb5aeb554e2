"""Comparing methods in Tune: which ones and with what, the run over the recording, its curves and its misses."""
