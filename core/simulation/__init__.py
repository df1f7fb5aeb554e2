"""Simulated event cameras: ball flights, scenes, and a sensor model that turns intensity changes into events."""

from core.simulation.recording import SimulatedRecording, ensure_demo, simulate_recording
from core.simulation.scene import SceneConfig, scene_named
from core.simulation.sensor import SensorConfig
from core.simulation.serve import ServeConfig
from core.simulation.serves import FlightSeries, draw_serves
from core.simulation.stereo import Chunk, StereoConfig, simulate_stereo
from core.simulation.truth import ball_truth, pixel_truth, truth_times

__all__ = [
    "Chunk",
    "FlightSeries",
    "SceneConfig",
    "SensorConfig",
    "ServeConfig",
    "SimulatedRecording",
    "StereoConfig",
    "ball_truth",
    "draw_serves",
    "ensure_demo",
    "pixel_truth",
    "scene_named",
    "simulate_recording",
    "simulate_stereo",
    "truth_times",
]
