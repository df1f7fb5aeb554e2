"""The flame graph counts what works, and not what waits."""

from pathlib import Path

from docs.flame_graph import main, read_profile

PROFILE = """\
thread (7): MainThread;main (app/cli/main.py:9);Server.run (core/live/link/server.py:4);step (core/a.py:10) 6
thread (7): MainThread;main (app/cli/main.py:9);Server.run (core/live/link/server.py:5);step (core/a.py:12) 3
thread (7): MainThread;main (app/cli/main.py:9);Server.run (core/live/link/server.py:5);Poller.poll (zmq/p.py:3) 90
thread (8): event-camera_1;Thread.run (threading.py:1);_worker (concurrent/futures/thread.py:83);see (core/b.py:1) 2
thread (9): event-camera_0;Thread.run (threading.py:1);_worker (concurrent/futures/thread.py:81) 50
thread (9): event-camera_0;Thread.run (threading.py:1);_worker (concurrent/futures/thread.py:83);see (core/b.py:2) 4
"""


def test_lines_of_a_function_and_threads_of_a_kind_count_together_and_waiting_does_not() -> None:
    root = read_profile(PROFILE.splitlines())
    assert root.count == 15
    threads = {frame.name: frame for frame in root.inner.values()}
    assert {name: frame.count for name, frame in threads.items()} == {"MainThread": 9, "event-camera": 6}
    (server,) = threads["MainThread"].inner.values()
    (step,) = server.inner.values()
    assert (server.name, step.name, step.file, step.count) == ("Server.run", "step", "core/a.py", 9)
    (see,) = threads["event-camera"].inner.values()
    assert (see.name, see.count) == ("see", 6)


def test_it_is_drawn(tmp_path: Path) -> None:
    profile, out = tmp_path / "simulation.folded", tmp_path / "flame.svg"
    profile.write_text(PROFILE, "utf-8")
    assert main([str(profile), "--out", str(out)]) == 0
    drawn = out.read_text("utf-8")
    assert "simulation: 15 samples that did not wait" in drawn and "Server.run" in drawn and "Poller" not in drawn
