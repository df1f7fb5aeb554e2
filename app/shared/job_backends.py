"""Where long work of a browser runs: on this machine, or on the cluster given on the command line.

A browser chooses between two words; an address never comes from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from core.errors import CommandError
from core.jobs import JobBackend

THIS_MACHINE: Final = "this machine"
THE_CLUSTER: Final = "the cluster"


@dataclass(frozen=True, slots=True)
class JobBackends:
    """The available backends.

    Raises:
        JobsError: if the address is none of a cluster, or one of a plain one beyond this machine.
    """

    cluster: str | None = None
    """Address of a Dask scheduler."""

    def __post_init__(self) -> None:
        JobBackend(cluster=self.cluster)

    @property
    def offered(self) -> tuple[str, ...]:
        """Names of the backends, the default first."""
        return (THIS_MACHINE,) if self.cluster is None else (THIS_MACHINE, THE_CLUSTER)

    def flags(self, place: str, jobs: int) -> tuple[str, ...]:
        """Command line flags that select this backend; `jobs` tasks at a time on this machine.

        Raises:
            CommandError: for a place that is not offered.
        """
        if place not in self.offered:
            raise CommandError("no such backend", expected=" or ".join(self.offered), got=repr(place[:20]))
        return ("--jobs", str(jobs)) if self.cluster is None or place == THIS_MACHINE else ("--cluster", self.cluster)


HERE_ONLY: Final = JobBackends()
