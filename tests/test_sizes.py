"""The sizes of the tests: what is left out where."""

import csv
import json
import subprocess
import sys

import pytest

from tests.sizes import DURATIONS, STORED_S, case_seconds

COLLECT = """
import json, sys, pytest

class Noter:
    def pytest_collection_finish(self, session):
        cases = [(item.nodeid, [mark.name for mark in item.iter_markers()]) for item in session.items]
        print("CASES" + json.dumps(cases))

sys.exit(pytest.main(["--collect-only", "-q", "tests/app", "tests/core", "tests/labels"], plugins=[Noter()]))
"""


@pytest.mark.long
@pytest.mark.slow
def test_the_inner_loop_and_the_gate_have_cases_of_every_room(request):
    done = subprocess.run(
        [sys.executable, "-c", COLLECT], cwd=request.config.rootpath, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-2000:]
    (line,) = (line for line in done.stdout.splitlines() if line.startswith("CASES"))
    rooms: dict[str, set[str]] = {"all": set(), "slow": set(), "long": set()}
    for name, marks in json.loads(line.removeprefix("CASES")):
        room = "/".join(name.partition("::")[0].split("/")[:-1][:3])
        rooms["all"].add(room)
        for left_out in {"slow", "long"} - set(marks):
            rooms[left_out].add(room)
    assert rooms["all"] == rooms["long"]
    assert rooms["all"] - rooms["slow"] == {"tests/app/browser"}


def test_what_a_file_sets_up_once_is_shared_out_among_its_cases():
    phases = {
        "a.py::first": {"setup": 6.0, "call": 1.0, "teardown": 0.5},
        "a.py::second": {"setup": 0.0, "call": 2.0, "teardown": 0.0},
        "a.py::third": {"setup": 0.0, "call": 0.0, "teardown": 0.0},
        "b.py::each_sets_up": {"setup": 3.0, "call": 0.0},
    }
    assert case_seconds(phases) == {
        "a.py::first": 3.5,
        "a.py::second": 4.0,
        "a.py::third": 2.0,
        "b.py::each_sets_up": 3.0,
    }


def test_what_was_measured_is_in_order_and_names_files_that_are_there(request):
    with DURATIONS.open(newline="", encoding="utf-8") as file:
        rows = [(float(seconds), name) for seconds, name in csv.reader(file)]
    assert rows == sorted(rows, key=lambda row: -row[0]) and rows[-1][0] >= STORED_S
    gone = {
        name.partition("::")[0] for _, name in rows if not (request.config.rootpath / name.partition("::")[0]).exists()
    }
    assert not gone, "make durations measures anew"
