"""What reads foreign text and bytes, on inputs that hypothesis thinks up: an answer, or the documented error."""

from __future__ import annotations

import contextlib
import tempfile
from pathlib import Path

import msgpack
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from app.client_session.view_link import commands_of, link_of, values_of
from app.state.client_state import ClientState, Configs, History, Playhead
from core.config import config_from_mapping, config_to_mapping
from core.detection import DetectorConfig
from core.errors import ConfigError, LinkError, RecordingError
from core.events import SensorSize
from core.learning.config import RunConfig
from core.live.link.messages import COMMANDS, KINDS, decode, encode
from core.recordings.sources.recognise import open_sources
from core.recordings.sources.source import DecodeReport
from core.text import parse_json, parse_toml, plain
from labels.formats import FORMATS
from labels.formats.exchange import ExportOptions, ImportContext, LabelSet
from labels.model import Label, LabelState

SENSOR = SensorSize(640, 480)
SCALARS = st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text(max_size=20)
ANYTHING = st.recursive(
    SCALARS | st.binary(max_size=40),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=12,
)
MESSAGES = KINDS | COMMANDS
FIELDS = sorted({name for kind in MESSAGES.values() for name in kind.__dataclass_fields__})
TEXTS = st.text(max_size=300)


@given(st.binary(max_size=400))
def test_bytes_on_the_link_are_a_message_or_an_error_of_it(data: bytes) -> None:
    with contextlib.suppress(LinkError):
        decode(data, MESSAGES)


@given(st.sampled_from(sorted(MESSAGES)), st.dictionaries(st.sampled_from(FIELDS), ANYTHING, max_size=8))
def test_fields_of_any_kind_are_a_message_that_comes_back_or_an_error(kind: str, fields: dict) -> None:
    data = bytes(msgpack.packb({"v": 1, **fields, "kind": kind}) or b"")
    with contextlib.suppress(LinkError):
        message = decode(data, MESSAGES)
        assert encode(decode(encode(message), MESSAGES)) == encode(message)


@given(TEXTS)
@example("[" * 100_000)
@example("a." * 50_000 + "a=1")
def test_json_and_toml_are_values_or_no_value(text: str) -> None:
    for parse in (parse_json, parse_toml):
        with contextlib.suppress(ValueError):
            parse(text)


@given(st.dictionaries(st.sampled_from(list(config_to_mapping(DetectorConfig()))) | st.text(max_size=8), ANYTHING))
def test_any_mapping_is_a_config_or_an_error_of_it(mapping: dict) -> None:
    for kind in (DetectorConfig, RunConfig):
        with contextlib.suppress(ConfigError):
            config = config_from_mapping(kind, mapping, where="here")
            assert config_from_mapping(kind, config_to_mapping(config), where="again") == config


@given(st.text())
def test_what_is_shown_of_a_text_is_one_line_without_commands(text: str) -> None:
    shown = plain(text)
    assert "\n" not in shown and "\x1b" not in shown and plain(shown) == shown


STATE = ClientState(
    "demo", ("left", "right"), "left", Playhead(1_000_000), History(Configs(DetectorConfig(), DetectorConfig()))
)
KEYS = st.sampled_from([part.partition("=")[0] for part in link_of(STATE, 0).split("&")])


@given(st.lists(st.tuples(KEYS | st.text(max_size=12), st.text(max_size=30)), max_size=12), TEXTS)
def test_a_link_changes_a_view_or_does_nothing(pairs: list[tuple[str, str]], text: str) -> None:
    state = STATE
    for values in (dict(pairs), values_of(text), values_of("&".join(f"{key}={value}" for key, value in pairs))):
        for command in commands_of(values, state):
            state = command.apply(state, 0.0)
    link_of(state, 0)


HEADS = st.sampled_from(
    [b"", b"% evt 3.0\n", b"% evt 2.0\n% geometry 640x480\n% end\n", b"#!AER-DAT4.0\r\n", b"PK\x03\x04"]
)


@given(HEADS, st.binary(max_size=300))
@pytest.mark.gate
def test_bytes_that_are_called_a_recording_give_events_or_an_error(head: bytes, rest: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "any.raw"
        path.write_bytes(head + rest)
        with contextlib.suppress(RecordingError):
            for source in open_sources(path, SENSOR):
                for events in source.read(DecodeReport()):
                    assert np.all(np.diff(events.t_us) >= 0) and int(events.x_px.max(initial=0)) < SENSOR.width_px


LABELS = st.builds(
    Label,
    t_us=st.integers(0, 10**12),
    state=st.sampled_from([LabelState.VISIBLE, LabelState.PARTLY_OCCLUDED]),
    x_px=st.floats(0, 639, width=32),
    y_px=st.floats(0, 479, width=32),
    r_px=st.floats(0.5, 60, width=32),
)


@given(st.lists(LABELS, max_size=6, unique_by=lambda label: label.t_us))
def test_labels_come_back_from_a_table_exactly(labels: list[Label]) -> None:
    ordered = tuple(sorted(labels, key=lambda label: label.t_us))
    form = FORMATS["csv"]
    with tempfile.TemporaryDirectory() as folder:
        form.write(LabelSet("uuid", "left", "me", SENSOR, ordered), Path(folder), ExportOptions())
        back = form.read(Path(folder), ImportContext(SENSOR))
    assert not back.rejections
    shape = [(label.t_us, label.state, label.x_px, label.y_px, label.r_px) for label in ordered]
    assert [(label.t_us, label.state, label.x_px, label.y_px, label.r_px) for label in back.labels] == shape


@pytest.mark.parametrize("name", sorted(set(FORMATS) - {"hdf5"}))
@given(text=TEXTS, data=st.binary(max_size=200))
@example(text="t_us\rstate\r", data=b"0")
@example(text="t_us,state\n" + "1" * 200_000, data=b"0")
def test_files_that_are_called_labels_are_read_or_rejected(name: str, text: str, data: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        for suffix in (".csv", ".json", ".xml", ".txt", ".jsonl"):
            (Path(folder) / f"a{suffix}").write_bytes(text.encode(errors="surrogatepass") if len(data) % 2 else data)
        read = FORMATS[name].read(Path(folder), ImportContext(SENSOR, np.arange(10) * 1000))
        assert all(label.t_us >= 0 for label in read.labels)
