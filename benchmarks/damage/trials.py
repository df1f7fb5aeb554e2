"""Many damage trials of one kind in child processes, which may die, hang or swell without harm."""

from __future__ import annotations

import queue
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Final

from benchmarks.damage.kinds import Outcome
from core.text.json_text import parse_json

SLOWEST_S: Final = 20.0
"""Opening a small damaged file takes no longer, on a loaded machine too; the child is ended then."""
START_S: Final = 300.0


@dataclass(slots=True)
class DamageCounts:
    """What came of so many damaged files."""

    outcomes: Counter[Outcome] = field(default_factory=Counter)
    slowest_s: float = 0.0
    problems: Counter[str] = field(default_factory=Counter)
    """Bugs, deaths and the like by their place, with how often."""
    first_of: dict[str, str] = field(default_factory=dict)
    """The trial and its damage that first led to each problem."""

    @property
    def trials(self) -> int:
        """How many there were."""
        return self.outcomes.total()

    def add(self, told: dict[str, object]) -> None:
        """One trial."""
        outcome: Outcome = told["outcome"]  # type: ignore[assignment]
        self.outcomes[outcome] += 1
        self.slowest_s = max(self.slowest_s, float(str(told.get("seconds", 0.0))))
        if outcome not in ("good", "noted", "line"):
            place = f"{outcome}: {told.get('said', '')}"
            self.problems[place] += 1
            self.first_of.setdefault(place, f"trial {told['trial']}: {told.get('damage', '')}")


def run_damage_trials(
    kind: str, count: int, *, seed: int, progress: Callable[[float], None] = lambda share: None
) -> DamageCounts:
    """Trials of the kind at "module:NAME". A child that dies is followed by another from the next trial on."""
    counts, first = DamageCounts(), 0
    while first < count:
        for told in _child(kind, seed, first, count):
            counts.add(told)
            first = int(str(told["trial"])) + 1
            progress(first / count)
    return counts


def _child(kind: str, seed: int, first: int, count: int) -> Iterator[dict[str, object]]:
    """What one child tells of its trials, and how it ended if not by itself."""
    command = [sys.executable, "-m", "benchmarks.damage.trial_child", kind, str(seed), str(first), str(count)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None and child.stderr is not None
        lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        said: list[str] = []
        threads = [
            threading.Thread(target=lambda: [*map(lines.put, child.stdout or ()), lines.put(None)], daemon=True),
            threading.Thread(target=lambda: said.extend(child.stderr or ()), daemon=True),
        ]
        for thread in threads:
            thread.start()
        under_way: int | None = None
        try:
            while True:
                told = _next(lines, SLOWEST_S if under_way is not None else START_S)
                if told is None:
                    break
                if "outcome" in told:
                    under_way = None
                    yield told
                else:
                    under_way = int(str(told["trial"]))
        except TimeoutError:
            child.kill()
            if under_way is not None:
                yield {"trial": under_way, "outcome": "slow", "seconds": SLOWEST_S}
                return
        code = child.wait()
        if under_way is not None:
            yield {"trial": under_way, "outcome": "died", "said": f"exit code {code}"}
        elif code:
            threads[1].join(5)
            raise RuntimeError(f"the trials of {kind} cannot begin: {''.join(said)[-2000:]}")


def _next(lines: queue.SimpleQueue[str | None], seconds: float) -> dict[str, object] | None:
    try:
        line = lines.get(timeout=seconds)
    except queue.Empty as error:
        raise TimeoutError from error
    return None if line is None else parse_json(line)
