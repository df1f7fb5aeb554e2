"""A cluster that speaks TLS, with real certificates: ours are taken, those of a stranger are not."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from core.jobs import JobBackend, open_jobs
from tests.waiting import PATIENCE_S

pytest.importorskip("distributed")
TLS = "DASK_DISTRIBUTED__COMM__TLS__"


def write_certificates(folder: Path) -> dict[str, str]:
    """Of an authority of its own, for all three parts: what `dask` and we look for in the environment."""
    import trustme

    folder.mkdir()
    authority, ca, cert, key = trustme.CA(), folder / "ca.pem", folder / "cert.pem", folder / "key.pem"
    issued = authority.issue_cert("127.0.0.1")
    authority.cert_pem.write_to_path(str(ca))
    issued.private_key_pem.write_to_path(str(key))
    issued.cert_chain_pems[0].write_to_path(str(cert))
    parts = {f"{TLS}{part}__CERT": str(cert) for part in ("SCHEDULER", "WORKER", "CLIENT")}
    return parts | {name.replace("CERT", "KEY"): str(key) for name in parts} | {f"{TLS}CA_FILE": str(ca)}


CLIENT = """
import sys
from core.errors import JobsError
from core.jobs import JobBackend, open_jobs
from pieces import digest
try:
    with open_jobs(JobBackend(cluster=sys.argv[1]), 3) as jobs:
        print(jobs.run(digest, [0, 1, 2]))
except JobsError as error:
    print(error)
"""


def ask(address: str, certificates: dict[str, str]) -> str:
    """What a process says that was started with these."""
    here = Path(__file__).parent
    path = os.pathsep.join(map(str, (here.parents[2], here)))
    found = subprocess.run(
        [sys.executable, "-c", CLIENT, address],
        env=os.environ | {"PYTHONPATH": path} | certificates,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert found.returncode == 0, found.stderr
    return found.stdout.strip()


def test_pieces_are_worked_on_behind_certificates_and_a_stranger_is_told_nothing(own_cluster, tmp_path: Path) -> None:
    from pieces import digest

    ours, theirs = (write_certificates(tmp_path / name) for name in ("ours", "theirs"))
    own_cluster.start(2, "--no-nanny", DASK_DISTRIBUTED__COMM__DEFAULT_SCHEME="tls", **ours)
    address = own_cluster.address
    assert address.startswith("tls://127.0.0.1:")
    with open_jobs(JobBackend(jobs=1), 3) as jobs:
        here = jobs.run(digest, [0, 1, 2])
    assert ask(address, ours) == str(here)
    refused = "no scheduler of a cluster answers; is `dask scheduler` running there, and this its address"
    stranger = f"{address}: {refused}, and its certificate of the authority in {TLS}CA_FILE?"
    assert ask(address, theirs) == stranger
    plain = address.replace("tls", "tcp")
    assert ask(plain, ours) == f"{plain}: {refused}?"
