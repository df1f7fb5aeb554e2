"""Simulated event cameras: ball flights, scenes, and a sensor model that turns intensity changes into events."""
