"""Measure what the tests see: change the code in one place, and ask the tests that reach it.

    python -m benchmarks.mutation.mutate AREA [--count 60] [--seed 0] [--jobs 1] [--list]

Draws lines of the area's code and one mutant on each, works on a copy of the tree, and writes each result at once to
`.mutation/AREA.jsonl`: a run that was killed goes on, and a changed file or killing test is asked again. Which test
reaches which line is measured first, a test file at a time (`reach.py`), and kept beside it.

Compiled kernels run as Python (NUMBA_DISABLE_JIT), or their mutants would have to be compiled. Tests that are too slow
like that, or fail, are asked last and compiled, about the mutants that all others let live.
"""

from __future__ import annotations

import argparse
import concurrent.futures
import hashlib
import json
import math
import queue
import random
import sys
import tempfile
import threading
import time
import tomllib
from collections import Counter
from pathlib import Path
from typing import Any, Final

from coverage import CoverageData

from benchmarks.mutation.copies import Copy, fork_server
from benchmarks.mutation.mutants import Mutant, find_mutants

SLOWEST_TEST_S: Final = 20.0
"""Tests that take longer on the processor without the compiler are asked last, and compiled."""
PATIENCE: Final = 3.0
"""A mutant may take so many times the time of its tests, on the processor; beyond that it is as good as killed."""
LONGEST_WAIT_S: Final = 900.0
"""On the clock, for a test that waits for ever while its reach is measured."""
LONGEST_S: Final = 60.0
"""Of the tests that are asked about one mutant, the fastest first."""
USAGE_ERROR: Final = 4
"""Exit status of pytest where a test that is asked for is not there."""
COMPILED_S: Final = 100.0
"""For the slow tests, compiled; what is not decided then counts as survived."""
HERE: Final = Path(__file__).resolve().parent
AREAS: Final = "benchmarks/mutation/areas.toml"
EQUIVALENT: Final = "benchmarks/mutation/equivalent.toml"
"""Both relative to the root of the tree whose code is changed."""


class Area:
    """The code that is changed, the tests that are asked, and what was measured of them."""

    def __init__(self, root: Path, name: str) -> None:
        areas = tomllib.loads((root / AREAS).read_text(encoding="utf-8"))
        self.libraries: list[str] = areas.pop("libraries", [])
        if name not in areas:
            raise SystemExit(f"no area {name}; there are {', '.join(areas)}")
        self.root, self.name, self.kept = root, name, root / ".mutation"
        self.kept.mkdir(exist_ok=True)
        without = tuple(areas[name].get("without", ()))
        self.sources: list[str] = areas[name]["sources"]
        files = [path for source in self.sources for path in _files(root, source, "*.py")]
        self.files = [path for path in files if not path.startswith(without)] if without else files
        self.tests = [path for folder in areas[name]["tests"] for path in _files(root, folder, "test_*.py")]

    def digest(self, *paths: str) -> str:
        """Of the content of files."""
        return hashlib.blake2b(b"".join((self.root / path).read_bytes() for path in paths), digest_size=8).hexdigest()


def _files(root: Path, folder: str, pattern: str) -> list[str]:
    place = root / folder
    if not place.exists():
        raise SystemExit(f"an area names {folder}, which is not there")
    found = [place] if place.is_file() else sorted(place.rglob(pattern))
    return [path.relative_to(root).as_posix() for path in found]


def arguments(*more: str) -> list[str]:
    """Of each call of pytest, for tests of every size: the tree's own choice of marks is set aside."""
    return ["-q", "-p", "no:cacheprovider", "-m", "", *more]


class Reach:
    """Which tests reach a line, with how long they take."""

    def __init__(self) -> None:
        self.lines: dict[str, dict[str, list[str]]] = {}
        self.seconds: dict[str, float] = {}
        self.slow: set[str] = set()
        self.users: dict[str, list[str]] = {}

    def take(self, measured: dict[str, Any]) -> None:
        """Add what was measured of a test file."""
        for test, facts in measured["tests"].items():
            if not facts["ran"] and facts["passed"]:
                continue  # skipped
            self.seconds[test] = facts["seconds"]
            if not facts["passed"]:
                self.slow.add(test)
            for fixture in facts["fixtures"]:
                self.users.setdefault(f"{measured['file']} fixture {fixture}", []).append(test)
        for path, lines in measured["lines"].items():
            mine = self.lines.setdefault(path, {})
            for line, contexts in lines.items():
                for context in contexts:
                    is_fixture = context.startswith("fixture ")
                    reached = self.users.get(f"{measured['file']} {context}", []) if is_fixture else [context]
                    mine.setdefault(line, []).extend(reached)

    def tests_of(self, mutant: Mutant) -> list[str]:
        """The fastest first. What runs at import matters to all tests that reach the file or mirror it, or else to all.

        A slow test was ended before it had reached all that it reaches: it is asked about every line of its files.
        """
        lines = self.lines.get(mutant.path, {})
        contexts = set(lines.get(str(mutant.line), []))
        anywhere = {context for every in lines.values() for context in every}
        if "" in contexts:
            mirror = f"test_{Path(mutant.path).name}::"  # may read a constant and run no line
            contexts = {test for test in self.seconds if test in anywhere or mirror in test} or set(self.seconds)
        contexts |= anywhere & self.slow
        return sorted(contexts & self.seconds.keys(), key=lambda test: (self.seconds[test], test))


def measure_reach(area: Area, copy: Copy) -> Reach:
    """From what is kept, or measured now."""
    reach = Reach()
    folder = area.kept / "reach"
    folder.mkdir(exist_ok=True)
    shared = _files(area.root, "tests", "conftest.py")
    code = area.digest(*area.files, *shared)
    for number, path in enumerate(area.tests):
        kept = folder / f"{area.name}-{code}-{area.digest(path)}-{Path(path).stem}.json"
        if not kept.exists():
            print(f"reach {number + 1}/{len(area.tests)} {path}", file=sys.stderr, flush=True)
            kept.write_text(json.dumps(_measure(area, copy, path)), encoding="utf-8")
        reach.take(json.loads(kept.read_text(encoding="utf-8")))
    return reach


def _measure(area: Area, copy: Copy, path: str) -> dict[str, Any]:
    data, tests = copy.root.parent / "coverage", copy.root.parent / "tests.json"
    data.unlink(missing_ok=True)
    tests.unlink(missing_ok=True)
    measured = {"data_file": str(data), "config_file": False, "include": [f"{copy.root}/{path}" for path in area.files]}
    env = {"REACH_TESTS": str(tests), "REACH_SLOWEST_S": f"{SLOWEST_TEST_S:g}"}
    status, said = copy.run(arguments("-p", "reach", f"--timeout={LONGEST_WAIT_S:g}", path), 900.0, measured, **env)
    if not tests.exists():
        raise SystemExit(f"{path} ended with status {status} and says nothing of its tests\n{said[-2000:]}")
    lines: dict[str, dict[int, list[str]]] = {}
    if data.exists():
        found = CoverageData(str(data))
        found.read()
        for file in found.measured_files():
            lines[Path(file).relative_to(copy.root).as_posix()] = found.contexts_by_lineno(file)
    return {"file": path, "tests": json.loads(tests.read_text("utf-8")), "lines": lines}


def judge(mutant: Mutant, text: str, reach: Reach, copy: Copy, start_s: float) -> dict[str, Any]:
    """Apply it, ask the tests, take it back."""
    asked = reach.tests_of(mutant)
    if not asked:
        return {"verdict": "not reached", "by": ""}
    fast, total = [], 0.0
    for test in (test for test in asked if test not in reach.slow):
        total += reach.seconds[test]
        if fast and total > LONGEST_S:
            break
        fast.append(test)
    place = copy.root / mutant.path
    place.write_text(mutant.apply(text), encoding="utf-8")
    try:
        limit = start_s + PATIENCE * sum(reach.seconds[test] for test in fast)
        status, said = copy.run(arguments("-x", "--timeout=0", *fast), limit) if fast else (0, "")
        if status == USAGE_ERROR:  # a case is named after the value that is changed: then all cases of its function
            functions = dict.fromkeys(test.partition("[")[0] for test in fast)
            status, said = copy.run(arguments("-x", "--timeout=0", *functions), limit)
        slow = [test for test in asked if test in reach.slow]
        if status == 0 and slow:
            status, said = copy.run_compiled(arguments("-x", "--timeout=0", *slow), COMPILED_S)
            status = max(status, 0)
    finally:
        place.write_text(text, encoding="utf-8")
    if status == 0:
        return {"verdict": "survived", "by": "", "asked": len(fast)}
    failed = [row.split()[1] for row in said.splitlines() if row.startswith(("FAILED ", "ERROR "))]
    return {"verdict": "killed", "by": failed[0] if failed else f"status {status}", "asked": len(fast)}


def draw(area: Area, count: int, seed: int) -> list[tuple[Mutant, str]]:
    """A mutant on each of `count` lines of the area."""
    by_line: dict[tuple[str, int], list[Mutant]] = {}
    texts = {path: (area.root / path).read_text(encoding="utf-8") for path in area.files}
    for path, text in texts.items():
        for mutant in find_mutants(path, text):
            by_line.setdefault((path, mutant.line), []).append(mutant)
    rng = random.Random(seed)
    lines = rng.sample(sorted(by_line), min(count, len(by_line)))
    return [(rng.choice(by_line[line]), texts[line[0]]) for line in lines]


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share.

    Not that of `core.metrics`: a fork that had imported the code of the checkout would not see the copy's mutant.
    """
    if not count:
        return 0.0, 1.0
    z, p = 1.96, hits / count
    middle, half = p + z * z / (2 * count), z * math.sqrt(p * (1 - p) / count + z * z / (4 * count * count))
    return (middle - half) / (1 + z * z / count), (middle + half) / (1 + z * z / count)


def still_true(row: dict[str, Any], area: Area, state: str) -> bool:
    """Whether the same file and the same killer, or else all tests, are as they were."""
    if row["source"] != area.digest(row["path"]):
        return False
    killer = row["by"].partition("::")[0]
    if row["verdict"] == "killed" and (area.root / killer).is_file():
        return row["killer"] == area.digest(killer)
    return row["state"] == state


def run(area: Area, drawn: list[tuple[Mutant, str]], jobs: int, start_s: float) -> list[dict[str, Any]]:
    """The results of all drawn mutants, those of earlier runs among them."""
    results, state = area.kept / f"{area.name}.jsonl", area.digest(*area.files, *area.tests)
    earlier = [json.loads(row) for row in results.read_text("utf-8").splitlines()] if results.exists() else []
    known = {(row["line"], row["start"], row["mutated"]): row for row in earlier if still_true(row, area, state)}
    accepted = tomllib.loads((area.root / EQUIVALENT).read_text(encoding="utf-8"))
    equivalent = {(one["line"], one["mutated"]) for one in accepted.get("mutant", ())}
    found: list[dict[str, Any]] = []
    lock = threading.Lock()
    with tempfile.TemporaryDirectory(prefix="mutate-") as folder:
        copies: queue.Queue[Copy] = queue.Queue()
        forks = fork_server(area.libraries)
        for number in range(jobs):
            copies.put(Copy(area.root, Path(folder) / str(number), forks))
        first = copies.get()
        reach = measure_reach(area, first)
        copies.put(first)

        def work(mutant: Mutant, text: str) -> None:
            line, mutated = mutant.lines(text)
            row = known.get((line, mutant.start, mutated))
            if row is None:
                began = time.monotonic()
                row = {"path": mutant.path, "at": mutant.line, "start": mutant.start, "kind": mutant.kind, "line": line}
                row |= {"mutated": mutated, "source": area.digest(mutant.path), "state": state}
                if (line, mutated) in equivalent:
                    row |= {"verdict": "equivalent", "by": ""}
                else:
                    copy = copies.get()
                    try:
                        row |= judge(mutant, text, reach, copy, start_s)
                    finally:
                        copies.put(copy)
                killer = row["by"].partition("::")[0]
                row["killer"] = area.digest(killer) if (area.root / killer).is_file() else ""
                row["seconds"] = round(time.monotonic() - began, 1)
            elif (line, mutated) in equivalent:
                row = {**row, "verdict": "equivalent"}
            with lock:
                found.append(row)
                if row not in earlier:
                    with results.open("a", encoding="utf-8") as file:
                        file.write(json.dumps(row) + "\n")
                said = f"{len(found)}/{len(drawn)} {row['verdict']} {row['path']}:{row['at']}"
                print(said, file=sys.stderr, flush=True)

        with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
            for future in [pool.submit(work, *one) for one in drawn]:
                future.result()
    return found


def report(area: Area, rows: list[dict[str, Any]]) -> str:
    """The table, and what lives."""
    parts = []
    for verdict in ("survived", "not reached"):
        for row in sorted((row for row in rows if row["verdict"] == verdict), key=lambda row: (row["path"], row["at"])):
            parts.append(f"{verdict}: {row['path']}:{row['at']} ({row['kind']})")
            parts += [f"  - {row['line']}", f"  + {row['mutated']}"]
    counts = Counter(row["verdict"] for row in rows)
    judged = len(rows) - counts["equivalent"]
    low, high = wilson(counts["killed"], judged)
    parts.append("area  mutants  killed  survived  not reached  equivalent  killed of those that can be (95 %)")
    share = counts["killed"] / judged if judged else math.nan
    numbers = "  ".join(str(counts[verdict]) for verdict in ("killed", "survived", "not reached", "equivalent"))
    parts.append(f"{area.name}  {len(rows)}  {numbers}  {share:.0%} ({low:.0%} to {high:.0%})")
    return "\n".join(parts)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("area")
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--start-s", type=float, default=40.0, help="allowed beside the tests' own time (40)")
    parser.add_argument("--list", action="store_true", help="only say what would be changed")
    parser.add_argument("--root", type=Path, default=HERE.parents[1], help="another tree, with its own areas.toml")
    options = parser.parse_args()
    area = Area(options.root.resolve(), options.area)
    drawn = draw(area, options.count, options.seed)
    if options.list:
        for mutant, text in drawn:
            print(f"{mutant.path}:{mutant.line} ({mutant.kind})", *mutant.lines(text), sep="\n    ")
        return
    print(report(area, run(area, drawn, options.jobs, options.start_s)))


if __name__ == "__main__":
    main()
