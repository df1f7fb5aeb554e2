"""Starts the live rally and makes the demo recording in the background, most urgent first.

A start is steps with progress, shared by all browsers and the terminal.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

from app.background.child import ChildProcess, share_in
from app.shared.frame_detector import frame_detector
from app.shared.live_rally import LiveRally, SimulationProcess, join_simulation
from app.shared.samples import DEMO
from app.shared.workspace import Workspace
from app.startup.chain import compile_chain, marker
from core.errors import RallyscopeError
from core.live.link.guard import ClientKeys
from core.live.link.live_source import LiveSource
from core.robot import RobotClient

logger = logging.getLogger(__name__)


FIRST_ONLY: Final = "on the first start only"
State = Literal["waiting", "running", "done", "failed"]
SAY_EVERY: Final = 0.25
LEAST_SHARE: Final = 0.03
LEAST_S: Final = 2.0
"""Share and time from which on a rate is measured: before, one kernel more doubles it."""
PICTURE_WITHIN_S: Final = 15.0
"""So long the detector's compilation leaves the processor to the page; then nobody seems to look."""


@dataclass(frozen=True, slots=True)
class Step:
    """One step."""

    title: str
    hint: str = ""
    """Hint: its duration or purpose."""
    state: State = "waiting"
    share: float = 0.0
    """Share that is done, 0 to 1."""
    problem: str = ""
    """Why it failed."""
    began_s: float = 0.0
    """Monotonic time at which it began, s."""

    def remaining_s(self, now_s: float) -> float | None:
        """Seconds that it will take yet, from the rate so far; None while too little is done to say."""
        passed_s = now_s - self.began_s
        if self.state != "running" or self.share < LEAST_SHARE or passed_s < LEAST_S:
            return None
        return passed_s * (1 - self.share) / self.share


class Preparation:
    """Steps by name, in order. All methods may be called from any thread."""

    def __init__(self, steps: dict[str, Step], say: Callable[[str], None] = lambda line: None) -> None:
        """`say` gets a line when a long step begins, at every quarter of it, and at its end."""
        self._steps = dict(steps)
        self.is_first = any(step.hint == FIRST_ONLY for step in steps.values())
        """Whether something has to be compiled, which takes so long that a recorded rally is shown at once."""
        self.picture_is_shown = threading.Event()
        """Set once a browser has shown a picture of the recorded rally, or of something else."""
        self._say = say
        self._reported: dict[str, float] = {}
        self._lock = threading.Lock()

    @property
    def steps(self) -> tuple[Step, ...]:
        """All steps."""
        with self._lock:
            return tuple(self._steps.values())

    @property
    def over(self) -> bool:
        """Whether all steps are done."""
        return all(step.state == "done" for step in self.steps)

    def begin(self, name: str) -> None:
        """Mark a step as running."""
        with self._lock:
            self._steps[name] = replace(self._steps[name], state="running", began_s=time.monotonic())

    def advance(self, name: str, share: float) -> None:
        """Update the share of a step that is done."""
        with self._lock:
            step = self._steps[name]
            if step.state != "running" or share < step.share:
                return
            self._steps[name] = replace(step, share=share)
            if name not in self._reported:
                self._reported[name] = 0.0
                self._say(f"{step.title}{f', {step.hint}' if step.hint else ''} ...")
            elif share - self._reported[name] >= SAY_EVERY:
                self._reported[name] = share - share % SAY_EVERY
                self._say(f"{step.title}: {share:.0%}")

    def finish(self, name: str) -> None:
        """Mark the step as done."""
        with self._lock:
            step = self._steps[name]
            self._steps[name] = replace(step, state="done", share=1.0)
            if name in self._reported:
                self._say(f"{step.title}: done after {time.monotonic() - step.began_s:.0f} s")

    def fail(self, name: str, problem: str) -> None:
        """Mark a step as failed."""
        with self._lock:
            step = self._steps[name]
            self._steps[name] = replace(step, state="failed", problem=problem)
            self._say(f"{step.title}: failed ({problem})")


OWN_STEPS: Final = {
    "simulation": Step("Compiling the simulation", FIRST_ONLY),
    "chain": Step("Compiling the ball detector and the player", FIRST_ONLY),
    "rally": Step("Starting the live rally"),
    "demo": Step("Making the demo recording", "once for each workspace"),
}
REMOTE_STEPS: Final = {
    "simulation": Step("Waiting for the simulation", "it is being compiled on the other machine"),
    "chain": OWN_STEPS["chain"],
    "rally": OWN_STEPS["rally"],
}
REPLAY_STEPS: Final = {"chain": OWN_STEPS["chain"], "rally": OWN_STEPS["rally"]}


class Startup:
    """Prepares what one app needs.

    Its children are ended with it; the live rally, once it is there, belongs to whoever took it.
    """

    def __init__(
        self,
        workspace: Workspace,
        *,
        address: str | None = None,
        source: LiveSource | None = None,
        arguments: Sequence[str] = (),
        say: Callable[[str], None] = lambda line: None,
        keys: ClientKeys | None = None,
        robot: RobotClient | None = None,
    ) -> None:
        """Begin: watch the simulation at an address, or start one with the arguments of `rallyscope sim-server`.

        Or watch a `source` that is there already, and is closed with the rally, or by `stop` if nobody took that.
        Beyond this machine the one at an address is watched with `keys`. A `robot` is closed as a `source` is.
        """
        self._workspace = workspace
        self._address, self._source, self._keys, self._robot = address, source, keys, robot
        self._say = say
        self._lock = threading.Lock()
        self._stopped = False
        steps = REPLAY_STEPS if source is not None else OWN_STEPS if address is None else REMOTE_STEPS
        place = marker()
        if place is not None and place.exists():  # compiled before: it is only loaded
            steps = {name: replace(step, hint="") if step.hint == FIRST_ONLY else step for name, step in steps.items()}
        self.preparation = Preparation(dict(steps), self._say_unless_stopped)
        self._children: list[ChildProcess] = []
        self._news = threading.Event()
        self._taker: Callable[[LiveRally], None] | None = None
        self._live: LiveRally | None = None
        self.problem: RallyscopeError | None = None
        """Why there is no live rally; empty if it is coming or there."""
        self._process: SimulationProcess | None = None
        if address is None and source is None:
            self._process = SimulationProcess(*arguments, on_progress=self._simulation_progress)
        self._chain_is_compiled = threading.Event()
        self._threads = [
            threading.Thread(target=self._guarded, args=(act, name), name=f"start-{name}", daemon=True)
            for name, act in (("chain", self._compile_chain), ("rally", self._bring_up_live))
        ]
        for thread in self._threads:
            thread.start()

    @property
    def remote(self) -> bool:
        """Whether the simulation runs elsewhere."""
        return self._address is not None

    def wait_for_change(self) -> None:
        """Wait until it is known whether the simulation is ready, in preparation, or missing."""
        self._news.wait()

    def hand_over(self, taker: Callable[[LiveRally], None]) -> None:
        """Pass the live rally to `taker`: at once if it is ready, else later from another thread."""
        with self._lock:
            self._taker = taker
            live = self._live
        if live is not None:
            taker(live)

    def stop(self) -> None:
        """Stop the preparation; nothing is reported from now on."""
        with self._lock:
            self._stopped = True
            children, process = tuple(self._children), self._process
            taken = self._taker is not None and self._live is not None
        self.preparation.picture_is_shown.set()  # whoever waits for it ends
        for child in children:
            child.stop()
        if process is not None and not taken:
            process.stop()
        if self._source is not None and not taken:
            self._source.close()
        if self._robot is not None and not taken:
            self._robot.close()

    # The steps, each in a thread.

    def _say_unless_stopped(self, line: str) -> None:
        with self._lock:
            if not self._stopped:
                self._say(line)

    def _guarded(self, act: Callable[[], None], name: str) -> None:
        try:
            act()
        except RallyscopeError as error:
            self._fail(name, str(error))
        except Exception:
            logger.exception("%s failed", name)
            self._fail(name, "this is a bug; the terminal shows where")

    def _fail(self, name: str, problem: str) -> None:
        if not self._stopped:
            self.preparation.fail(name, problem)
        self._chain_is_compiled.set()
        self._news.set()

    def _simulation_progress(self, share: float) -> None:
        self.preparation.advance("simulation", share)
        self._news.set()

    def _compile_chain(self) -> None:
        self.preparation.begin("chain")
        place = marker()
        if place is None:  # no cache for compiled code
            compile_chain(lambda ready, known: self.preparation.advance("chain", ready / known))
        elif not place.exists() and (problem := self._compile_in_child()) and not self._stopped:
            logger.warning("compiling ahead failed: %s", problem)  # the player compiles it then
        self.preparation.finish("chain")
        self._chain_is_compiled.set()

    def _compile_in_child(self) -> str:
        """Compile after the first picture; returns as `_run_child`.

        Two cores are busy until then: with the simulation, which takes longest, the app that loads, and the browser.
        """
        self.preparation.picture_is_shown.wait(PICTURE_WITHIN_S)
        return self._run_child("chain", "app.startup.chain")

    def _bring_up_live(self) -> None:
        if self._source is None:
            self.preparation.begin("simulation")
        try:
            live = self._replayed_rally() if self._source is not None else self._simulated_rally()
        except RallyscopeError as error:
            self.problem = error
            if not self._stopped:
                self.preparation.fail("simulation" if self._source is None else "rally", str(error))
            self._news.set()
            return
        with self._lock:
            self._live, taker, stopped = live, self._taker, self._stopped
        self.preparation.finish("rally")
        self._news.set()
        if stopped:
            live.close()
        elif taker is not None:
            taker(live)

    def _replayed_rally(self) -> LiveRally:
        assert self._source is not None
        self._chain_is_compiled.wait()
        self.preparation.begin("rally")
        return LiveRally(self._source, robot=self._robot, frame_detector=frame_detector())

    def _simulated_rally(self) -> LiveRally:
        return self._own_rally() if self._process is not None else self._remote_rally()

    def _own_rally(self) -> LiveRally:
        assert self._process is not None
        address = self._process.wait()
        self.preparation.finish("simulation")
        threading.Thread(target=self._guarded, args=(self._make_demo, "demo"), name="start-demo", daemon=True).start()
        self._chain_is_compiled.wait()
        self.preparation.begin("rally")
        return join_simulation(address, process=self._process)

    def _remote_rally(self) -> LiveRally:
        assert self._address is not None
        live = join_simulation(self._address, preparing=self._simulation_progress, keys=self._keys, robot=self._robot)
        self.preparation.finish("simulation")
        self.preparation.begin("rally")
        return live

    def _make_demo(self) -> None:
        self.preparation.begin("demo")
        path = self._workspace.recording_path(DEMO)
        if not path.exists() and (problem := self._run_child("demo", "app.startup.demo", str(path))):
            self.preparation.fail("demo", problem)
            return
        self.preparation.finish("demo")

    def _run_child(self, name: str, *command: str) -> str:
        """Run a child to its end; returns its last words if it failed, else nothing. Others may run beside it."""

        def hear(line: str) -> None:
            share = share_in(line)
            if share is not None:
                self.preparation.advance(name, share)

        with self._lock:
            if self._stopped:
                return "stopped"
            child = ChildProcess(*command, on_line=hear)
            self._children.append(child)
        return child.last_words if child.wait() else ""
