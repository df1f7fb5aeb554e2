"""The app's words in a sentence each, for tooltips; docs/use/glossary.md has the same."""

from __future__ import annotations

from typing import Final

PAGE: Final = "docs/use/glossary.md"

GLOSSARY: Final[dict[str, str]] = {
    "Auto-serve": "The simulation serves by itself, again and again, at the chosen speed.",
    "Bias": "An analogue setting of all pixels of an event camera, such as how much contrast makes an event.",
    "Block": "10 ms of the simulation: it is computed, published and followed as a whole.",
    "Calibration": "How far the ball is from the other camera's epipolar lines by a wrong pose: 1 px is too much.",
    "CDTA": "Case-dependent temporally adaptive reward: first it pays for returning the ball, later for placing it.",
    "Circularity": "4 pi area / perimeter^2 of a cluster's hull: 1 for a disc, 0.79 for a square.",
    "Cluster": "Events that lie close together (DBSCAN): the ball is one of them, a racket or a person are others.",
    "Epipolar line": "Where the other camera's ball must lie in this picture.",
    "Event": "What a pixel of an event camera reports: it became brighter (ON) or darker (OFF), and when.",
    "Event camera": "A camera that takes no pictures: each pixel reports changes of light by itself, as they happen.",
    "Hit predicted after the bounce": "Where the ball will meet the hitting plane, by what was seen since.",
    "Hit predicted before the bounce": "The same by what was seen before it: the racket sets out early.",
    "Hitting plane": "x = -1.42 m, 5 cm behind the robot's edge of the table, where the racket meets the ball.",
    "Latency": "How long it takes from what happens to what is done about it.",
    "Leading polarity": "Whether the ball's front edge makes the ON or the OFF events.",
    "Pace": "Simulated seconds per second: below real time is slow motion.",
    "Precision": "The share of a detector's answers that are a ball.",
    "Recall": "The share of the balls that were found.",
    "ROI": "Region of interest: the part of the sensor, round the last ball, that is searched.",
    "Seen to racket": "From the end of the window that the ball was seen in to the command on its way to the racket.",
    "Sensor readout": "The way of events out of a camera: more than it can carry come late, or never.",
    "Sigma": "Standard deviation: two of three errors are smaller.",
    "Skipped blocks": "Blocks that came while the machine was busy: too late to be of use, they were not followed.",
    "Snap": "A click moves to the circle that fits the events.",
    "Solidity": "Pixels with events per area of a cluster's hull.",
    "Stereo": "Two cameras that see the same ball: it is where their lines of sight meet.",
    "Stereo mismatch": "How far the cameras' circles are from one ball in space, in pixels: below 1 is good.",
    "Tube": "Round a predicted flight: two standard deviations to each side.",
    "Window": "The stretch of time whose events are looked at together.",
}
"""Explanation by word, in alphabetical order."""


def tooltip(word: str) -> str:
    """The sentence, and where the others are."""
    return f"{word}: {GLOSSARY[word]} ({PAGE})"
