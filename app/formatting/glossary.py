"""The app's words in a sentence each, for tooltips; docs/use/glossary.md has the same."""

from __future__ import annotations

from typing import Final

PAGE: Final = "docs/use/glossary.md"

GLOSSARY: Final[dict[str, str]] = {
    "Auto-serve": "The simulation serves repeatedly at the chosen speed.",
    "Bias": "An analogue setting of all pixels of an event camera, such as how much contrast makes an event.",
    "Block": "10 ms of the simulation: it is computed, published and processed as a unit.",
    "Calibration": "Its drift: distance of the ball from the other camera's epipolar line; 1 px is too much.",
    "CDTA": "Case-dependent temporally adaptive reward: first it pays for returning the ball, later for placing it.",
    "Circularity": "4 pi area / perimeter^2 of a cluster's hull: 1 for a disc, 0.79 for a square.",
    "Cluster": "Events that lie close together (DBSCAN): the ball is one of them, a racket or a person are others.",
    "Epipolar line": "Where the other camera's ball must lie in this picture.",
    "Event": "What a pixel of an event camera reports: it became brighter (ON) or darker (OFF), and when.",
    "Event camera": "A camera that takes no pictures: each pixel reports changes of light by itself, as they happen.",
    "Hit predicted after the bounce": "Where it crosses the hitting plane, predicted after the bounce.",
    "Hit predicted before the bounce": "The same, predicted before the bounce, so that the racket can start early.",
    "Hitting plane": "x = -1.42 m, 5 cm behind the robot's edge of the table, where the racket meets the ball.",
    "Latency": "Time from an event to the reaction to it.",
    "Leading polarity": "Whether the ball's front edge makes the ON or the OFF events.",
    "Pace": "Simulated seconds per second: below real time is slow motion.",
    "Precision": "The share of a detector's answers that are a ball.",
    "Recall": "The share of the balls that were found.",
    "ROI": "Region of interest: the part of the sensor, round the last ball, that is searched.",
    "Seen to racket": "Time from the end of the window with the ball to the racket command being sent.",
    "Sensor readout": "Transfer of events out of a camera: above its capacity they come late, or never.",
    "Sigma": "Standard deviation: two of three errors are smaller.",
    "Skipped blocks": "Blocks that arrived too late to be processed, because the machine was busy.",
    "Snap": "A click moves to the circle that fits the events.",
    "Solidity": "Pixels with events per area of a cluster's hull.",
    "Stereo": "Two cameras that see the same ball: its position is where their lines of sight meet.",
    "Stereo mismatch": "How far the cameras' circles are from one ball in space, in pixels: below 1 is good.",
    "Tube": "Round a predicted flight: two standard deviations to each side.",
    "Window": "The time interval whose events are processed together.",
}
"""Explanation by word, in alphabetical order."""


def tooltip(word: str) -> str:
    """Tooltip with the explanation, and where to find the glossary."""
    return f"{word}: {GLOSSARY[word]} ({PAGE})"
