"""What is printed of a test that hangs."""

import subprocess
import sys

HANGS = """
import subprocess, sys
from tests.stacks import pytest_timeout_set_timer, pytest_timeout_cancel_timer, pytest_runtest_makereport

code = "def stand_still():\\n    print(flush=True)\\n    input()\\nstand_still()"
child = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
child.stdout.readline()  # it stands still before the test begins, whose time is short

def wait_for_a_child_that_does_not_answer():
    child.wait()

def test_hangs():
    wait_for_a_child_that_does_not_answer()
"""


def test_a_test_that_hangs_shows_the_stacks_of_its_process_and_of_its_children(tmp_path, request):
    (tmp_path / "test_hangs.py").write_text(HANGS)
    (tmp_path / "conftest.py").write_text(HANGS.partition("code = ")[0])
    arguments = ["-m", "pytest", "-p", "no:cacheprovider", "--rootdir", tmp_path, "-o", "timeout=4", tmp_path]
    done = subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, cwd=request.config.rootpath, check=False
    )
    said = done.stdout + done.stderr
    assert done.returncode == 1 and "Timeout" in said
    assert "wait_for_a_child_that_does_not_answer" in said
    assert "stand_still" in said.partition("stacks of child processes")[2] or "ermission" in said
