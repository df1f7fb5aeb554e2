"""Simulated event cameras: ball flights, scenes, and a sensor model that turns intensity changes into events."""

from core.simulation.event_cameras.event_camera import Chunk, StereoConfig, simulate_stereo
from core.simulation.flights import FlightSeries, LaunchConfig, draw_serve_series
from core.simulation.recording import SimulatedRecording, ensure_demo, simulate_recording
from core.simulation.scenes.scene import SceneConfig, scene_named
from core.simulation.sensor.sensor import SensorConfig
from core.simulation.truth import ball_truth, pixel_truth, pixel_truths, truth_times

__all__ = [
    "Chunk",
    "FlightSeries",
    "LaunchConfig",
    "SceneConfig",
    "SensorConfig",
    "SimulatedRecording",
    "StereoConfig",
    "ball_truth",
    "draw_serve_series",
    "ensure_demo",
    "pixel_truth",
    "pixel_truths",
    "scene_named",
    "simulate_recording",
    "simulate_stereo",
    "truth_times",
]
