"""Three sizes of the tests, by what each case was measured to take: `make quick`, `make test`, `make test-all`.

`durations.csv` holds what was measured (`make durations` writes it anew); a case that it does not name is taken for a
short one. Marks follow from it:

- `slow`: longer than `QUICK_S`, or in a browser. `make quick` leaves it out.
- `long`: longer than `TEST_S`, or in a browser, and without the mark `gate`. `make test` leaves it out. A case with the
  mark `gate` notices what no shorter one does.
"""

import csv
import statistics
from collections import defaultdict
from pathlib import Path

import pytest
from xdist.remote import Producer
from xdist.scheduler import LoadScopeScheduling

from tests.waiting import PATIENCE_S

DURATIONS = Path(__file__).parent / "durations.csv"
QUICK_S = 0.5
TEST_S = 2.0
STORED_S = 0.2
"""Shorter cases are not stored."""
LAST_WORDS = 4000
"""Characters of what a repeated case printed and logged."""


BROWSER = "tests/app/browser/"
TIMEOUT_S, BROWSER_TIMEOUT_S = 1.2 * PATIENCE_S, 2.4 * PATIENCE_S
"""What a case has for all it does, where it says nothing else."""


class Scheduling(LoadScopeScheduling):
    """A file stays with one worker, and so do all browser tests: a page drawn in software fills a machine."""

    def _split_scope(self, nodeid: str) -> str:
        return BROWSER if nodeid.startswith(BROWSER) else nodeid.partition("::")[0]


def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> Scheduling:
    """How cases are given to workers."""
    return Scheduling(config, log)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that measures."""
    parser.addoption("--durations-to", type=Path, help="write what each case takes to this file", default=None)


def pytest_configure(config: pytest.Config) -> None:
    """Measure where that is asked for; workers report to the first process."""
    file = config.getoption("--durations-to")
    if file is not None and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Recorder(file))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark cases by their size; browser tests begin first, then the longest files."""
    seconds = read_durations()
    files: dict[Path, float] = defaultdict(float)
    for item in items:
        took_s = seconds.get(item.nodeid, 0.0)
        files[item.path] += took_s
        browser = item.nodeid.startswith(BROWSER) or item.get_closest_marker("browser") is not None
        if browser or took_s > QUICK_S:
            item.add_marker(pytest.mark.slow)
        if (browser or took_s > TEST_S) and item.get_closest_marker("gate") is None:
            item.add_marker(pytest.mark.long)
        if browser:
            item.add_marker(pytest.mark.browser)
            item.add_marker(pytest.mark.flaky(reruns=1))  # the summary names each one that was repeated
        if item.get_closest_marker("timeout") is None and item.config.getoption("timeout") is None:
            item.add_marker(pytest.mark.timeout(BROWSER_TIMEOUT_S if browser else TIMEOUT_S))
    items.sort(key=lambda item: (not item.nodeid.startswith(BROWSER), -files[item.path]))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Why the first attempt of a repeated case failed: the summary has its name alone."""
    for report in terminalreporter.stats.get("rerun", ()):
        terminalreporter.section(f"first attempt of {report.nodeid}")
        terminalreporter.write_line(report.longreprtext)
        for name, content in report.sections:
            terminalreporter.write_line(f"{name}:\n{content[-LAST_WORDS:]}")


def read_durations() -> dict[str, float]:
    """What each case took when it was measured, s, by its node id."""
    if not DURATIONS.is_file():
        return {}
    with DURATIONS.open(newline="", encoding="utf-8") as file:
        return {name: float(took_s) for took_s, name in csv.reader(file)}


class Recorder:
    """A pytest plugin that writes `durations.csv` after a run of all tests: `pytest --durations-to FILE`."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._phases: dict[str, dict[str, float]] = defaultdict(dict)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note one phase of a case."""
        self._phases[report.nodeid][report.when or ""] = report.duration

    def pytest_sessionfinish(self) -> None:
        """Write what was noted."""
        rows = sorted((took_s, name) for name, took_s in case_seconds(self._phases).items() if took_s >= STORED_S)
        with self._file.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows((f"{took_s:.1f}", name) for took_s, name in rows[::-1])


def case_seconds(phases: dict[str, dict[str, float]]) -> dict[str, float]:
    """What each case takes, s; what is set up once in a file is shared out among its cases."""
    files: dict[str, list[str]] = defaultdict(list)
    for name in phases:
        files[name.partition("::")[0]].append(name)
    seconds = {}
    for names in files.values():
        own_s = statistics.median(phases[name].get("setup", 0.0) for name in names)
        shared_s = statistics.fmean(phases[name].get("setup", 0.0) for name in names) - own_s
        for name in names:
            seconds[name] = (
                phases[name].get("call", 0.0) + phases[name].get("teardown", 0.0) + own_s + max(shared_s, 0.0)
            )
    return seconds
