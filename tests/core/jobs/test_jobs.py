"""Which engines there are, and which addresses are refused before anything is sent."""

import pytest

from core.errors import JobsError
from core.jobs import JobBackend


@pytest.mark.parametrize(
    "address",
    ["tcp://127.0.0.1:8786", "tcp://localhost:8786", "tcp://[::1]:8786", "tls://10.0.0.7:8786", "tls://node1:1"],
)
def test_this_machine_may_be_plain_and_others_are_encrypted(address: str) -> None:
    assert JobBackend(cluster=address).cluster == address


@pytest.mark.parametrize(
    "address", ["tcp://10.0.0.7:8786", "tcp://node1:8786", "tcp://0.0.0.0:8786", "tcp://[fe80::1]:1"]
)
def test_a_plain_address_beyond_this_machine_is_refused_with_the_remedy(address: str) -> None:
    with pytest.raises(JobsError, match=r"needs certificates; expected tls://, got '.*; .*--tls-cert.*ssh -L") as error:
        JobBackend(cluster=address)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "address",
    ["", "8786", "127.0.0.1:8786", "tcp://127.0.0.1", "tcp://:8786", "tcp://127.0.0.1:port", "tcp://127.0.0.1:99999",
     "http://127.0.0.1:8786", "tcp://127.0.0.1:8786/x", "tcp://me@127.0.0.1:8786", "tcp://[::1:8786", "tls://a:0"],
)  # fmt: skip
def test_what_is_no_address_is_one_line(address: str) -> None:
    with pytest.raises(JobsError, match=r"not the address of a cluster; expected tcp://127.0.0.1:PORT or tls://"):
        JobBackend(cluster=address)


def test_jobs_and_a_cluster_do_not_go_together() -> None:
    with pytest.raises(JobsError, match="not both"):
        JobBackend(jobs=2, cluster="tcp://127.0.0.1:8786")
    with pytest.raises(JobsError, match="at least 1"):
        JobBackend(jobs=0)


def test_there_are_no_more_processes_than_pieces() -> None:
    assert JobBackend(jobs=8).processes(3) == 3 and JobBackend(jobs=2).processes(3) == 2
    assert JobBackend(jobs=4).processes(0) == 1 and JobBackend().processes(1000) >= 1
