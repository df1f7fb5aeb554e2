"""What the report says around its tables. Paragraphs are divided by empty lines; names in braces are filled in."""

from __future__ import annotations

from typing import Final

TITLE: Final = "Perception: every method on recordings after the paper's"
PICTURES: Final = "Every method on the same window"

CONDITIONS: Final = """
Made by `rallyscope bench paper-perception --count {count}`: the seven simulated recordings of the preset `paper7`
(1280x720, two cameras; three with the ball only, four with people, the last one a rally of two players), with the
settings of each method as they come. Seeds: {seeds}. {brackets}

The recordings are simulated after the paper's description; its own cannot be had. Equal figures would not mean equal
recordings.

`yolo` looks at the frames of the same recordings, the others at their events. {frame_detector}

More seeds: `--count 10`. A set is made where it is missing (415 seconds of one core's time, 0.5 GB), what was measured
is kept, and the same command goes on where it was ended.

Machine: {machine}.
"""
OVER_SEEDS: Final = """
In brackets the 95 % bootstrap interval of the mean over the seeds; with fewer than about ten it is narrower than it
should be.
"""
OVER_RECORDINGS: Final = """
With fewer than {fewest} seeds there is no interval over seeds: in brackets are the least and the greatest of the
single recordings, which says how much they differ and nothing of how sure the figure is.
"""

FRAME_DETECTOR: Final = """
It is YOLOv4-tiny with the weights that come with the package, trained on rendered pictures with seeds of their own
(docs/how/detector.md); of sharp frames of 0.5 ms that it was not trained on it finds {sharp}, and with 0.9 or more it
counts as a rival. A time of the recall's grid is found with a right answer within half a frame's period, of events
within half a window, so that `yolo` is asked no more often than there are frames.
"""
NO_FRAME_DETECTOR: Final = """
It has no weights here, so that its rows are empty and nothing is said of what the paper compares with RGB, except the
data, for which the size of the frames is enough: `rallyscope train-detector yolo` makes some.
"""

COMPARISONS: Final = """
The paper states ratios and not how they are computed; `how` says what is divided here. Where it says "up to", the best
recording counts. The rivals are our implementations, tuned on other simulated flights; how the paper tuned its own,
it does not say.

For the latency: light to answer takes `{method}` {least_ms:.2f} ms (p50), so {saved:.1f} % less would mean a frame
detector that takes {frame_ms:.0f} ms or more. {frames}
"""
NO_FRAMES: Final = "The recordings have no frames."
FRAMES: Final = """
Of a frame, light waits {wait_ms:.1f} ms on average for the end of the exposure ({exposure_ms:.1f} ms), one frame
comes every {period_ms:.1f} ms, the read-out takes {readout_ms:.1f} ms (assumed: that of a sensor of 120 pictures a
second at most), and the detector comes on top. For each frame with a
ball, {megabytes:.2f} MB of frames have to be read.
"""
DATA_HOW: Final = """
1 - bytes of all events ({event_bytes} each) per right answer / bytes of all frames (3 a pixel) per frame with a ball;
the best recording
"""
DATA_OURS: Final = """
{best}; all recordings {whole}; frames of one byte a pixel {mosaic}; per second, whatever is found, {rate}; all frames
per right answer of `yolo`, all recordings {found}
"""
LATENCY_HOW: Final = """
1 - latency from events / latency of `yolo` on frames, both light to answer p50 over all recordings, exposure and
read-out included
"""
LATENCY_OURS: Final = """
{all}; if the network took no time {sensed}
"""
RECALL_HOW: Final = """
recall from events / recall of `yolo` on frames - 1; the best recording
"""
RECALL_OURS: Final = """
{best}; all recordings {whole}
"""

SCENES: Final = """
Ours / the paper's. The paper does not say whether its error is a mean or a median; the verdict takes the mean. It
holds with at least the paper's precision and recall, and at most its error.
"""

LIMITS: Final = """
One read per event: a compiled pass over the events takes {read_ns:.2f} ns for each; no detector that looks at every
event of its window can be faster.

Circle-fit bound: n points all round a circle, each with a radial error of sigma = 1/sqrt(12) = 0.29 px (an event says
that the edge was somewhere in its pixel), leave a variance of at least 2 sigma^2 / n on each axis of the centre
(Cramer-Rao; points on one side only leave more), hence a median distance of at least sqrt(2 ln 2) sigma sqrt(2 / n).
`events` counts as n every event within 1.5 px of the true edge at its time, `pixels` only the different pixels among
them: a pixel's second event says little new. Of one window; for `refined` of the history that it looks back on (3.5
px of motion). `ebpp` keeps a surface of older edges and may use more than its window. The time at which an event came
says more than its pixel alone, so the bound is no law for methods that use it.
"""

DEFINITIONS: Final = """
Precision: every answer without the ball within 8 px at the time that the answer states is false. Recall: of the whole
milliseconds at which the whole disc is in view and has been for 10 ms, those with a right answer within half a
window. Errors are those of right answers, at the time that they state. Both cameras, balls of any speed.

3D: distance of the chain's points from the ball at their time. Hitting point: along the plane x = -1.42 m, what the
chain says at its last step 100 ms before the ball is there; `told` is the share of balls for which it says something.
`paper` predicts by the paper's five-point rule and checks no sizes; the others with the filter, told the physics.

Bytes per detection: all events that the detector was given, {event_bytes} bytes each (EVT 2.0), over its right
answers; of `yolo` all frames, 3 bytes a pixel. (In the columns of our files an event has 13 bytes before
compression.)

CPU: processor time of one thread for one step of one camera that answered, warm, events in memory. Light to answer:
the sensor's delay ({delay_ms:.2f} ms) + waiting for the end of the window + the step. p50 takes half a window and the
median step; p99 the whole window, as for light that came first, and the 99th percentile of the steps: at most one
answer in a hundred comes later. Transfer from the camera is not in it. For `yolo`: half the exposure (p50) or all
of it (p99), the read-out ({readout_ms:.1f} ms, assumed) and the step; light between two exposures is not waited for,
since nobody sees it.

Recovery: from a ball's appearance, after at least 5 ms without one and for at least 10 ms, to the end of the first
window with a right answer; balls that are never found count as endless.
"""

PICTURE_WORDS: Final = """
The window lies in the middle of those with the whole ball in the first camera's picture, whatever the methods say of
it. Events of the last 2 ms: ON orange, OFF blue. The dashed black circle is the ball at the time that the answer
states, the green one with a cross the answer; one that is farther away is not in the picture.
"""


def paragraphs(text: str, **values: object) -> tuple[str, ...]:
    """The paragraphs of a text, filled in, a line each."""
    return tuple(" ".join(part.split()) for part in text.format(**values).strip().split("\n\n"))


def one_line(text: str, **values: object) -> str:
    """A text of a single paragraph."""
    return " ".join(paragraphs(text, **values))
