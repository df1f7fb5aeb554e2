"""Event files of others: one file per format, all giving an `EventSource`; `open_sources` recognises which it is."""

from core.recordings.sources.recognise import open_sources
from core.recordings.sources.source import EventSource

__all__ = ["EventSource", "open_sources"]
