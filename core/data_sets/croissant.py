"""The card of a data set as Croissant (JSON-LD), which data set search and loaders of machine learning read.

Source: the Croissant format specification 1.0 of MLCommons. Every recording and the index are files with their hashes;
the columns of the index are a record set, one record a recording.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import pyarrow as pa

from core.data_sets.index import INDEX, schema_of
from core.files import replace_file

CROISSANT: Final = "croissant.json"
CONFORMS_TO: Final = "http://mlcommons.org/croissant/1.0"
_CONTEXT: Final[dict[str, object]] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileObject": "cr:fileObject",
    "fileProperty": "cr:fileProperty",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
_TYPES: Final = {pa.string(): "sc:Text", pa.int64(): "sc:Integer", pa.float64(): "sc:Float", pa.bool_(): "sc:Boolean"}
_MEANINGS: Final = {
    "file": "The recording, an HDF5 file beside the index",
    "uuid": "Identity of the recording, which labels refer to",
    "duration_us": "Length, in microseconds",
    "scene": "What was before the cameras beside the ball",
    "placement": "Where the cameras stood",
    "noise_hz": "Rate of background events of each pixel",
    "events": "Events of all cameras",
    "centres": "Visible true ball centres in the pictures of all cameras",
    "points_3d": "True positions of the ball in the world",
    "frames": "Pictures of ordinary cameras",
    "split": "training, validation or test",
    "recording": "The recording that the flight is cut out of",
    "start_us": "Start of the flight in that recording, in microseconds",
    "end_us": "End of the flight in that recording, in microseconds",
}


def write_croissant(folder: Path, manifest: Mapping[str, object]) -> None:
    """Write the card beside the index, which has to be there; the same data set gives the same bytes."""
    index = (folder / INDEX).read_bytes()
    card = make_croissant(manifest, hashlib.sha256(index).hexdigest(), len(index))
    replace_file(folder / CROISSANT, (json.dumps(card, indent=2) + "\n").encode(), durable=True)


def make_croissant(manifest: Mapping[str, object], index_sha256: str, index_bytes: int) -> dict[str, object]:
    """The card of a data set with this manifest and index."""
    recordings = manifest["recordings"]
    assert isinstance(recordings, Sequence)
    index = _file_object(INDEX, "application/x-parquet", index_sha256, index_bytes)
    files = [_file_object(entry["file"], "application/x-hdf5", entry["sha256"], entry["bytes"]) for entry in recordings]
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": CONFORMS_TO,
        "name": str(manifest["title"]) or "rallyscope data set",
        "description": manifest.get("description")
        or (
            f"Simulated event-camera recordings of table tennis with the true ball in the pictures and in the world, "
            f"made by rallyscope {manifest['rallyscope']} with seed {manifest['seed']}: one HDF5 file a recording, and "
            f"an index of one row each."
        ),
        "version": "1.0.0",
        "isLiveDataset": False,
        "distribution": [index, *files],
        "recordSet": [
            {
                "@type": "cr:RecordSet",
                "@id": "recordings",
                "name": "recordings",
                "description": "One record a recording: the columns of the index that are plain values.",
                "key": {"@id": "recordings/file"},
                "field": [_field(column) for column in schema_of(manifest) if _plain_type(column) is not None],
            }
        ],
    }


def _file_object(name: str, encoding: str, sha256: str, size: int) -> dict[str, object]:
    return {
        "@type": "cr:FileObject",
        "@id": name,
        "name": name,
        "contentUrl": name,
        "contentSize": f"{size} B",
        "encodingFormat": encoding,
        "sha256": sha256,
    }


def _plain_type(column: pa.Field) -> str | None:
    """Type of the values of a column, or of the lists in it; None for tables within the table."""
    return _TYPES.get(column.type.value_type if pa.types.is_list(column.type) else column.type)


def _field(column: pa.Field) -> dict[str, object]:
    field: dict[str, object] = {
        "@type": "cr:Field",
        "@id": f"recordings/{column.name}",
        "name": f"recordings/{column.name}",
        "description": _MEANINGS.get(column.name, column.name.replace("_", " ")),
        "dataType": _plain_type(column),
        "source": {"fileObject": {"@id": INDEX}, "extract": {"column": column.name}},
    }
    return {**field, "repeated": True} if pa.types.is_list(column.type) else field
