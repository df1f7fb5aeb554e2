"""Why a method finds no ball in a recording, or in the last seconds of a live source, and which other method does.

From a sample, in the background.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Final

from app.background.jobs import LatestWins
from app.formatting import html_text, percent
from app.modes.tune.candidates import reasons_html
from core.detection import DetectorConfig
from core.detection.methods import Method, method_config
from core.metrics.run import MethodSample, best_other, duration_of, sample_method, sample_rimless
from core.recordings import CameraStream
from core.text import counted

REST_S: Final = 1.5
"""A config is sampled when it has not changed for so long: not at each step of a slider."""
KEPT: Final = 32
REASONS: Final = 3
"""Reasons that are named: in many recordings the first one is that most windows have nothing in them."""
LIVE_US: Final = 5_000_000
"""The newest part of a live source that is sampled."""
LIVE_VALID_S: Final = 10.0
"""A live source is sampled again when its sample is so old and there is still no ball."""
SAME: Final[Mapping[Method, Method]] = {"paper": "auto"}
"""Methods that are not tried, as another one differs in one setting only."""


@dataclass(frozen=True, slots=True, eq=False)
class SampleRequest:
    """A method of a camera to sample, and the configs of all methods."""

    key: Hashable
    stream: CameraStream
    method: Method
    configs: Mapping[Method, DetectorConfig]
    live: bool = False
    """Whether the camera is of a live source, of which the last `LIVE_US` are sampled."""


@dataclass(frozen=True, slots=True)
class SampleAnswer:
    """The sample of the method, and of the best other one if this one finds nothing."""

    sample: MethodSample
    other: MethodSample | None
    live: bool = False
    rimless: MethodSample | None = None
    """That of `refined` with the settings for a ball without a rim, if it finds more than the other."""


class NothingFound:
    """Samples a recording once its current window has no ball, and says why nothing is found in any."""

    def __init__(
        self, pool: Executor, later: Callable[[Callable[[], None]], None], failed: Callable[[Exception], None],
        show: Callable[[str, bool], None],
    ) -> None:  # fmt: skip
        """`show` gets the text, and whether the settings for a ball without a rim are to be offered."""
        self._later, self._show = later, show
        self._known: OrderedDict[Hashable, SampleAnswer] = OrderedDict()
        self._valid_until_s: dict[Hashable, float] = {}
        self._wanted: SampleRequest | None = None
        self._asked: Hashable = None
        self._since_s = 0.0
        self._work = LatestWins(pool, answer_sample, self._done, failed)

    def want(self, request: SampleRequest | None, wall_s: float) -> None:
        """Want the sample of a config whose window has no ball; None: it has one, or there is nothing to sample."""
        if (request and request.key) == (self._wanted and self._wanted.key):
            return
        self._wanted, self._since_s = request, wall_s
        self._refresh()

    def tick(self, wall_s: float) -> None:
        """Start the sample once the config has rested."""
        wanted = self._wanted
        if wanted is None or wanted.key == self._asked or wall_s - self._since_s < REST_S:
            return
        if wanted.key in self._known and wall_s < self._valid_until_s.get(wanted.key, wall_s + 1.0):
            return
        self._asked = wanted.key
        if wanted.live:
            self._valid_until_s[wanted.key] = wall_s + LIVE_VALID_S
        self._work.submit(wanted)

    def close(self) -> None:
        """The browser has disconnected."""
        self._work.close()

    def _done(self, request: SampleRequest, answer: SampleAnswer) -> None:
        self._later(lambda: self._keep(request, answer))

    def _keep(self, request: SampleRequest, answer: SampleAnswer) -> None:
        if request.key == self._asked:
            self._asked = None
        self._known[request.key] = answer
        while len(self._known) > KEPT:
            oldest, _ = self._known.popitem(last=False)
            self._valid_until_s.pop(oldest, None)
        self._refresh()

    def _refresh(self) -> None:
        answer = None if self._wanted is None else self._known.get(self._wanted.key)
        offered = answer is not None and answer.rimless is not None
        self._show("" if answer is None else nothing_found_html(answer), offered)


def answer_sample(request: SampleRequest) -> SampleAnswer:
    """Sample the method; if it finds nothing, the others too, and the settings for a ball without a rim."""
    stream, span_us = request.stream, None
    if request.live:
        end_us = duration_of(stream)
        span_us = max(0, end_us - LIVE_US), end_us
    config = request.configs[request.method]
    sample = sample_method(stream, request.method, config, span_us)
    others = {name: config for name, config in request.configs.items() if name not in SAME}
    if sample.found or not sample.windows:
        return SampleAnswer(sample, None, request.live)
    other = best_other(stream, request.method, others, span_us)
    defaults_fail = request.method == "refined" and config == method_config("refined")
    rimless = sample_rimless(stream, span_us, defaults_fail=defaults_fail)
    if rimless is not None and other is not None and other.share >= rimless.share:
        rimless = None
    return SampleAnswer(sample, other, request.live, rimless)


def nothing_found_html(answer: SampleAnswer) -> str:
    """Why nothing is found, with links to the sliders, and what else finds a ball; empty if one is found."""
    sample, other = answer.sample, answer.other
    if sample.found or not sample.windows:
        return ""
    over = f"the last {1e-6 * LIVE_US:g} s" if answer.live else "this recording"
    windows = counted(sample.windows, "window")
    text = f"<b>{html_text(sample.method)} finds no ball in a sample of {windows} of {over}.</b>"
    shares = (f"{reasons_html((one,))} in {percent(one.windows / sample.windows)}" for one in sample.reasons[:REASONS])
    if sample.reasons:
        text += f" Most often: {', '.join(shares)}."
    if other is not None:
        text += f" <b>{html_text(other.method)}</b> finds one in {percent(other.share)}."
    if (soft := answer.rimless) is not None:
        text += f" <b>{html_text(soft.method)}</b> with the settings for a ball without a rim: {percent(soft.share)}."
    # As high as its letters: what it takes is missing below, where the candidates of the window are.
    return f"<div style='font-size:12.5px;line-height:15px;padding:0 12px 6px;margin-top:-6px'>{text}</div>"
