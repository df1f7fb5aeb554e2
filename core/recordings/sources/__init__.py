"""Event files of others: one file per format, all giving an `EventSource`; `open_sources` recognises which it is."""

from core.recordings.sources.making import make_source, make_table_source
from core.recordings.sources.readers import register_reader
from core.recordings.sources.recognise import open_sources
from core.recordings.sources.source import (
    BINARY_FACTS,
    Columns,
    DecodeReport,
    EventSource,
    Fact,
    FactOrigin,
    RawColumns,
)

__all__ = [
    "BINARY_FACTS",
    "Columns",
    "DecodeReport",
    "EventSource",
    "Fact",
    "FactOrigin",
    "RawColumns",
    "make_source",
    "make_table_source",
    "open_sources",
    "register_reader",
]
