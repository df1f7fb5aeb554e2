"""What tests ask of processes that are not their own children."""

from pathlib import Path


def is_alive(pid: int) -> bool:
    """Whether it runs; one that nobody waits for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False
