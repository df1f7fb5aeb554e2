"""Simulated event cameras: the event kernel, one camera, several on one clock."""
