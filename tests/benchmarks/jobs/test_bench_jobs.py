"""The bench of engines runs with few pieces, and leaves no process."""

import socket
import subprocess
import sys

import pytest

from benchmarks.jobs import bench_jobs
from benchmarks.jobs.counting_relay import counting_relay


def test_every_engine_has_a_row_and_the_cluster_its_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    started: list[subprocess.Popen] = []
    begin = subprocess.Popen

    def remember(*arguments, **more):
        started.append(begin(*arguments, **more))
        return started[-1]

    monkeypatch.setattr("benchmarks.jobs.loopback_cluster.subprocess.Popen", remember)
    monkeypatch.setattr(bench_jobs, "WORKERS", (1,))
    shares: list[float] = []
    report = bench_jobs.run(shares.append, count=30)
    here, cluster = report["rows"]  # type: ignore[misc]
    assert (here["engine"], cluster["engine"]) == ("this process", "cluster")
    assert 0 < here["ms_per_piece"] < cluster["ms_per_piece"]
    assert cluster["bytes_sent"] > 300, "a recording's plan and the function"
    assert cluster["bytes_received"] > 20 and here["bytes_sent"] is None
    assert shares == [0.5, 1.0] and len(started) == 2
    assert all(process.returncode is not None for process in started), "nobody is left"


def test_the_relay_counts_what_passes_in_each_direction() -> None:
    echo = "import socket\nd = socket.create_server(('127.0.0.1', 0))\nprint(d.getsockname()[1], flush=True)\n"
    echo += "c, _ = d.accept()\nn = len(c.recv(100))\nc.sendall(b'x' * 3 * n)\nc.close()\n"
    with subprocess.Popen([sys.executable, "-c", echo], stdout=subprocess.PIPE) as server:
        assert server.stdout is not None
        address = f"tcp://127.0.0.1:{int(server.stdout.readline())}"
        with counting_relay(address) as relay:
            with socket.create_connection(("127.0.0.1", int(relay.address.rpartition(":")[2])), 30) as client:
                client.sendall(b"12345")
                heard = b"".join(iter(lambda: client.recv(100), b""))
            assert heard == b"x" * 15 and (relay.sent_bytes, relay.received_bytes) == (5, 15)
