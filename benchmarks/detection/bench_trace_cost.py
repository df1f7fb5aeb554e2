"""What the recording of traces costs the default method: steps with and without its hooks, and steps with a trace.

    python -m benchmarks.detection.bench_trace_cost [--repeats 6] [--json]

The three run in one process, in turn on each window, in thread CPU time. The detector without hooks is made from the
same source, with each `if self._recorder is not None:` taken out.
"""

from __future__ import annotations

import argparse
import ast
import inspect
import json
import time
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from benchmarks.detection.bench_detection import simulate_flights
from core.config import get_section
from core.detection import RefinedDetector, refined_config
from core.detection.refined import detector as detector_module
from core.detection.window import windows_between
from core.events import SensorSize, Window
from core.metrics.run import duration_of

SEED: Final = 41
WINDOW_US: Final = 1000
Step = Callable[[Window], object]


class _WithoutHooks(ast.NodeTransformer):
    """Takes out every statement that runs only while a trace is recorded."""

    removed = 0

    def visit_If(self, node: ast.If) -> ast.AST | None:
        """Nothing for a hook, else the statement with its own parts visited."""
        if ast.unparse(node.test) == "self._recorder is not None":
            self.removed += 1
            return None
        return self.generic_visit(node)


def detector_without_hooks() -> type[RefinedDetector]:
    """The class of the default method without the code that records traces."""
    tree = ast.parse(inspect.getsource(detector_module))
    (source,) = (one for one in tree.body if isinstance(one, ast.ClassDef) and one.name == "RefinedDetector")
    stripper = _WithoutHooks()
    stripped = ast.fix_missing_locations(stripper.visit(source))
    assert stripper.removed, "there are hooks"
    namespace = dict(vars(detector_module))
    exec(compile(ast.Module([stripped], []), detector_module.__file__ or "", "exec"), namespace)
    return namespace["RefinedDetector"]


def measure_costs(windows: Sequence[Window], sensor: SensorSize, repeats: int) -> dict[str, dict[str, float]]:
    """CPU time of a step, p50 and p99 in us, and their ratios to that without hooks; by variant."""
    config = get_section(refined_config(), "refined")
    detectors = {
        "without hooks": detector_without_hooks()(config, sensor),
        "step": RefinedDetector(config, sensor),
        "trace": RefinedDetector(config, sensor),
    }
    steps: dict[str, Step] = {name: one.step for name, one in detectors.items()}
    steps["trace"] = detectors["trace"].trace
    names = list(steps)
    for name in names:  # compiled before anything is timed
        for window in windows[:200]:
            steps[name](window)
    seconds: dict[str, list[float]] = {name: [] for name in names}
    for repeat in range(repeats):
        for one in detectors.values():
            one.reset()
        for number, window in enumerate(windows):
            first = (number + repeat) % len(names)  # each comes first as often: the first one reads the events anew
            for name in names[first:] + names[:first]:
                start_s = time.thread_time()
                steps[name](window)
                seconds[name].append(time.thread_time() - start_s)
    base = np.percentile(seconds["without hooks"], [50, 99])
    rows = {}
    for name in names:
        p50, p99 = np.percentile(seconds[name], [50, 99])
        rows[name] = {"p50_us": 1e6 * p50, "p99_us": 1e6 * p99, "ratio_p50": p50 / base[0], "ratio_p99": p99 / base[1]}
    return rows


def main() -> None:
    """Print a row for each variant."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=6)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    stream = simulate_flights("person", 1.0, (5.0,), seed=SEED)[0]
    windows = list(windows_between(stream, 0, duration_of(stream), WINDOW_US))
    rows = measure_costs(windows, stream.sensor, arguments.repeats)
    if arguments.json:
        print(json.dumps({"windows": len(windows), "repeats": arguments.repeats, "rows": rows}))
        return
    print(f"{len(windows)} windows of {WINDOW_US} us, {arguments.repeats} times")
    for name, row in rows.items():
        ratios = f"ratio p50 {row['ratio_p50']:.3f}, p99 {row['ratio_p99']:.3f}"
        print(f"{name:14} p50 {row['p50_us']:6.0f} us, p99 {row['p99_us']:6.0f} us, {ratios}")


if __name__ == "__main__":
    main()
