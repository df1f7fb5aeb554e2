"""The user's choice of where tasks run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final
from urllib.parse import urlsplit

from core.errors import JobsError
from core.files import usable_cores
from core.text.host import is_loopback


@dataclass(frozen=True, slots=True, kw_only=True)
class JobBackend:
    """Processes of this machine, or the workers of a Dask cluster."""

    jobs: int | None = None
    """Tasks at a time on this machine; None for one per core."""
    cluster: str | None = None
    """Address of the cluster's scheduler, `tcp://` on this machine and `tls://` beyond it; None for here."""

    def __post_init__(self) -> None:
        if self.jobs is not None and self.jobs < 1:
            raise JobsError("no such number of jobs", expected="at least 1", got=self.jobs)
        if self.cluster is not None:
            if self.jobs is not None:
                raise JobsError("a cluster has its own number of workers", remedy="give jobs or a cluster, not both")
            _check_address(self.cluster)

    def processes(self, most: int) -> int:
        """Number of processes on this machine for at most `most` tasks."""
        return max(1, min(self.jobs or usable_cores(), most))


HERE: Final = JobBackend()
"""One process per core of this machine."""
ALONE: Final = JobBackend(jobs=1)
"""This process only."""


def _check_address(address: str) -> None:
    """Raise JobsError unless the connection to the cluster is local or encrypted."""
    expected = "tcp://127.0.0.1:PORT or tls://HOST:PORT"
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise JobsError("not the address of a cluster", expected=expected, got=repr(address[:100])) from error
    if parts.scheme not in ("tcp", "tls") or not host or not port or parts.path or parts.query or parts.username:
        raise JobsError("not the address of a cluster", expected=expected, got=repr(address[:100]))
    if parts.scheme == "tcp" and not is_loopback(host):
        remedy = "start scheduler and workers with --tls-ca-file, --tls-cert and --tls-key, or use `ssh -L`"
        raise JobsError(
            "a cluster beyond this machine needs certificates",
            expected="tls://",
            got=repr(address[:100]),
            remedy=remedy,
        )
