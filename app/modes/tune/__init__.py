"""Tune: the detector, stage by stage, and the score of a config against labels."""
