"""A sample of the trials of `bench faults`: nothing acknowledged is lost, endings are clear, the next start works.

And the trials find it when something is lost, unclear or not on the disk.
"""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from benchmarks.app.bench_faults import ONCE, choose_pairs, rows_of
from benchmarks.app.faults.injections import Injection
from benchmarks.app.faults.jobs import JOBS
from benchmarks.app.faults.trials import EndedTrial, FaultName, FaultResult, FaultTrials, pause, unclear_ending
from core.errors import CommandError

PROBED: dict[str, tuple[FaultName, ...]] = {
    "recording": ("killed", "disk full", "device error", "read-only folder", "stopped", "power cut", "clock stepped"),
    "import": ("killed", "device error", "power cut"),
    "labelling": ("killed", "disk full", "read-only folder", "clock stepped"),
    "tune in parallel": ("worker killed",),
    "training": ("disk full",),
    "export": ("killed", "disk full"),
}
"""Data sets take longer: they are for the bench."""


@pytest.mark.parametrize("name", PROBED)
def test_nothing_acknowledged_is_lost_and_every_ending_is_clear(name: str, tmp_path: Path) -> None:
    trials = FaultTrials(JOBS[name], tmp_path / "trials")
    for number, fault in enumerate(PROBED[name]):
        result = trials.try_fault(fault, np.random.default_rng((3, number)), pause_s=0.3)
        assert (result.lost, result.unclear) == (0, ""), f"{fault}: {result}"
        assert result.struck or fault != "worker killed", "this seed's moment is early enough"


def test_a_process_that_has_ended_is_not_paused_and_one_that_runs_goes_on() -> None:
    with subprocess.Popen(["sleep", "0"]) as ended:
        ended.wait()
        pause(ended.pid, 0.01)
    with subprocess.Popen(["sleep", "60"]) as running:
        pause(running.pid, 0.01)
        assert running.poll() is None
        running.terminate()


def test_every_fault_is_tried_on_every_job_but_where_python_does_not_write() -> None:
    pairs = choose_pairs(None)
    alone = [name for name, job in JOBS.items() if not job.workers]
    assert len(pairs) == len(alone) * (len(get_args(FaultName)) - 1) - 2 + 2 * (len(JOBS) - len(alone))
    assert {fault for job, fault in pairs if job == "labelling"} == {*get_args(FaultName)} - {
        "device error",
        "power cut",
        "worker killed",
    }
    assert [job for job, fault in pairs if fault == "worker killed"] == ["data set in parallel", "tune in parallel"]
    assert choose_pairs("killed") == [(name, "killed") for name in JOBS]
    with pytest.raises(CommandError, match=r"no such fault, and no such job; expected killed, .* got earthquake"):
        choose_pairs("earthquake")
    assert set(ONCE) < set(get_args(FaultName))


def ending(code: int, errors: str) -> EndedTrial:
    return EndedTrial(code, "", errors, 1.0, 0, ())


def test_an_ending_is_clear_if_it_is_good_or_one_line_with_a_reason() -> None:
    assert unclear_ending(ending(0, "Importing a.csv: 1 s so far\n")) == ""
    line = "rallyscope: /a: cannot write: No space left on device; free some space\n"
    assert unclear_ending(ending(2, f"Training ddpg: 5 s so far\n{line}")) == ""
    for code, errors in (
        (1, "Traceback (most recent call last):\n  ...\nOSError\nrallyscope: this is a bug\n"),
        (2, f"a warning\n{line}"),
        (2, "rallyscope: it did not work\n"),
        (-7, ""),
    ):
        assert unclear_ending(ending(code, errors))


def test_what_was_lost_or_unclear_misses_the_goal() -> None:
    results = [FaultResult(0, "", True), FaultResult(3, "exit code 1", True), FaultResult(0, "", False)]
    lost, unclear = rows_of("killed, import", results)
    assert (lost["measured"], lost["met"], lost["note"]) == (3.0, False, "3 trials, 2 struck")
    assert (unclear["measured"], unclear["met"], unclear["note"]) == (1.0, False, "exit code 1")


FORGETS = """
import os, sys
from pathlib import Path
from benchmarks.app.faults.injections import Injection, inject
from benchmarks.app.faults.trials import _unsynced
from core.files import replace_file
folder = Path(sys.argv[1])
disk = inject(Injection(folder=folder, fails_from=int(sys.argv[2]) or None))
replace_file(folder / "kept", b"a", durable=True)
print(_unsynced(folder, disk))
replace_file(folder / "risked", b"b", durable=False)
print(_unsynced(folder, disk))
"""


def test_the_watched_disk_sees_what_a_power_cut_could_take_and_fails_from_a_step_on(tmp_path: Path) -> None:
    import subprocess
    import sys

    def run(fails_from: int) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-c", FORGETS, str(tmp_path), str(fails_from)]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    said = run(0).stdout.splitlines()
    assert said == ["()", "('content of risked', 'name of risked')"]
    for path in tmp_path.iterdir():
        path.unlink()
    failed = run(2)
    assert "Input/output error" in failed.stderr and list(tmp_path.iterdir()) == []
    assert Injection(folder=tmp_path).fails_from is None
