"""Settings of a search for thresholds."""

from __future__ import annotations

from dataclasses import dataclass

from core.config import check_settings, setting


@dataclass(frozen=True, slots=True, kw_only=True)
class TuningConfig:
    """Length of the search, and the split of the recording."""

    trials: int = setting(64, 1, 100_000)
    """Number of scored configs, the start config included."""
    seed: int = setting(0, 0, 2**31 - 1)
    """Seed of the proposals: the same seed gives the same answer with any number of processes."""
    batch: int = setting(8, 1, 64)
    """Proposals that are made at once, and answered in their order: more would keep more processes busy, and learn less
    from one to the next."""
    blocks: int = setting(20, 2, 1000)
    """Blocks of time that the recording is cut into; half of them are held out."""
    gap_us: int = setting(10_000, 0, 1_000_000, step=1000)
    """At the beginning of a block so much is left out, that no flight's neighbouring windows are on both sides; but
    never more than a third of the block."""

    def __post_init__(self) -> None:
        check_settings(self)
