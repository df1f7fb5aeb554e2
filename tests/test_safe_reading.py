"""Nothing that comes from a file, a link or a browser runs code, fills the memory or takes for ever."""

from __future__ import annotations

import ast
import json
import pickle
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import numpy as np
import pytest
import yaml

from core.cameras import load_calibration
from core.cameras.opencv_yaml import OpenCVLoader
from core.config import load_config
from core.data_sets.card import read_manifest
from core.detection import DetectorConfig
from core.errors import RallyscopeError
from core.files import read_json
from core.learning.agents.policy import read_policy
from core.learning.config import RunConfig
from core.physics.ball_states import read_ball_states
from core.recordings import open_recording
from core.text import parse_json
from core.yaml_loader import UntaggedLoader
from labels.formats.documents import DocumentError, parse_xml
from labels.journal import unpack_line
from tests.sources import ROOT, SOURCES, name_of, tree_of
from tests.waiting import PATIENCE_S

FORBIDDEN = {
    "eval", "exec", "compile", "__import__", "pickle.load", "pickle.loads", "pickle.Unpickler",
    "marshal.load", "marshal.loads", "tomllib.load", "tomllib.loads",
    "shelve.open", "dill.load", "cloudpickle.load", "joblib.load", "torch.load", "yaml.unsafe_load", "yaml.full_load",
    "os.system", "os.popen", "subprocess.getoutput", "json.load", "json.loads", "tarfile.open", "shutil.unpack_archive",
    "xml.etree.ElementTree.parse", "ElementTree.parse", "ElementTree.fromstring",
    "minidom.parse", "minidom.parseString", "importlib.util.spec_from_file_location",
}  # fmt: skip
ALLOWED = {
    ("core/jit.py", "pickle.loads"),  # our own compiled kernels, in the cache of this user; see docs/how/security.md
    ("core/registry.py", "importlib.util.spec_from_file_location"),  # plugins, which whoever starts us names
    ("core/text.py", "json.loads"),
    ("core/text.py", "tomllib.loads"),
    ("labels/formats/documents.py", "json.loads"),
}
TOO_DEEP = 100_000
ALIASES = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{chr(98 + n)}: &{chr(98 + n)} [{', '.join(['*' + chr(97 + n)] * 10)}]\n" for n in range(9)
)


def test_nothing_is_unpickled_or_run() -> None:
    calls = [(path, node) for path in SOURCES for node in ast.walk(tree_of(path)) if isinstance(node, ast.Call)]
    assert len(calls) > 10_000
    for path, call in calls:
        where, line = name_of(path), f"{name_of(path)}:{call.lineno}"
        name = ast.unparse(call.func)
        words = {word.arg: ast.unparse(word.value) for word in call.keywords}
        assert name not in FORBIDDEN or (where, name) in ALLOWED, f"{line} {name}"
        assert words.get("allow_pickle", "False") == "False", line
        assert words.get("shell", "False") == "False", line
        if name == "yaml.load":
            assert words.get("Loader") in ("OpenCVLoader", "UntaggedLoader"), line
    assert issubclass(OpenCVLoader, yaml.SafeLoader) and issubclass(UntaggedLoader, yaml.SafeLoader)


def test_the_loader_of_calibrations_makes_plain_values_only(tmp_path: Path) -> None:
    path, mark = tmp_path / "rig.yaml", tmp_path / "ran"
    path.write_text(
        "image_width: 4\nimage_height: 4\n"
        f"camera_matrix: !!python/object/apply:pathlib.Path.touch [!!python/object/apply:pathlib.Path ['{mark}']]"
    )
    with pytest.raises(RallyscopeError, match="camera_matrix cannot be read"):
        load_calibration(path)
    assert not mark.exists()


class Runs:
    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self):
        return Path.touch, (self.mark,)


def test_pickles_in_numpy_files_are_not_read(tmp_path: Path) -> None:
    mark, path = tmp_path / "ran", tmp_path / "events.npy"
    np.save(path, np.array([Runs(mark)], dtype=object), allow_pickle=True)
    bare = tmp_path / "bare.npy"
    bare.write_bytes(pickle.dumps(Runs(mark)))
    packed = tmp_path / "packed.npz"
    np.savez(packed, events=np.array([Runs(mark)], dtype=object))
    for file in (path, bare, packed):
        with pytest.raises(RallyscopeError):
            open_recording(file)
    assert not mark.exists()


@pytest.mark.parametrize("text", ["[" * TOO_DEEP, '{"a":' * TOO_DEEP, "[" * TOO_DEEP + "]" * TOO_DEEP, "9" * 10_000])
def test_json_that_is_too_deep_or_too_long_a_number_is_no_json(text: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"too deeply|digits|double quotes"):
        parse_json(text)
    path = tmp_path / "manifest.json"
    path.write_text(text)
    assert read_json(path) == {}
    for read in (
        read_ball_states,
        lambda path: read_manifest(path.parent),
        lambda path: unpack_line(path.read_bytes()),
    ):
        with pytest.raises(RallyscopeError) as caught:
            read(path)
        assert "\n" not in str(caught.value) and len(str(caught.value)) < 3000


@pytest.mark.parametrize(
    ("text", "refused", "is_parsed"),
    [
        ("a = " + "[" * TOO_DEEP, "nested too deeply", True),
        ("a = " + "{a=" * TOO_DEEP, "nested too deeply", True),
        (".".join("a" * 50_000) + " = 1", "a key with too many parts", False),
        ("a = {b = 1, " + " . ".join("a" * 50_000) + " = 1}", "a key with too many parts", False),
        ("a = " + "9" * 10_000, r"the limit \(4300 digits\)", True),
        ("a = 1\n" * 300_000, "expected at most 1 MiB, got 1800000 bytes", False),
    ],
    ids=["lists", "tables", "dots", "inner-dots", "digits", "large"],
)
@pytest.mark.parametrize("kind", [DetectorConfig, RunConfig])
def test_toml_that_is_too_deep_or_too_large_is_one_line(
    text: str, refused: str, is_parsed: bool, kind: type, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the parser would need minutes or gigabytes for never comes to it."""
    path = tmp_path / "config.toml"
    path.write_text(text)
    parsed: list[str] = []
    loads = tomllib.loads
    monkeypatch.setattr(tomllib, "loads", lambda text: (parsed.append(text), loads(text))[1])
    with pytest.raises(RallyscopeError, match=refused) as caught:
        load_config(kind, path)
    assert "\n" not in str(caught.value) and parsed == [text] * is_parsed


@pytest.mark.parametrize(
    ("rest", "refused"),
    [
        (
            "image_width: *j\nimage_height: *j\ncamera_matrix: *j\ndistortion_coefficients: *j",
            "image_width is not a whole number",
        ),
        ("camera_matrix: !!opencv-matrix {rows: *j, cols: *j, dt: d, data: *j}", "for which picture size it is"),
        (
            "cam0: {camera_model: *j, intrinsics: *j, resolution: *j, distortion_model: radtan, distortion_coeffs: *j}",
            "unsupported camera model",
        ),
        ("k: " + "[" * TOO_DEEP, "neither TOML nor YAML"),
    ],
)
def test_yaml_whose_anchors_name_billions_is_one_line(rest: str, refused: str, tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text(ALIASES + rest)
    with pytest.raises(RallyscopeError, match=refused) as caught:
        load_calibration(path)
    assert len(str(caught.value)) < 3000


ENTITIES = '<!DOCTYPE l [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;">]><annotation><folder>&b;</folder></annotation>'
OUTSIDE = '<!DOCTYPE l [<!ENTITY x SYSTEM "file:///etc/hostname">]><annotation>&x;</annotation>'


@pytest.mark.parametrize("text", [ENTITIES, OUTSIDE, "<a>" * TOO_DEEP])
def test_xml_neither_expands_nor_fetches_nor_nests_without_end(text: str) -> None:
    with pytest.raises(DocumentError, match=r"not read|nested"):
        parse_xml(text)


def test_a_huge_attribute_is_only_a_long_text() -> None:
    assert len(parse_xml(f"<a b='{'x' * 10_000_000}'/>").attribute("b")) == 10_000_000


def test_a_policy_that_is_a_pickle_is_refused(tmp_path: Path) -> None:
    mark, path = tmp_path / "ran", tmp_path / "policy.safetensors"
    path.write_bytes(pickle.dumps(Runs(mark)))
    with pytest.raises(RallyscopeError):
        read_policy(path)
    assert not mark.exists()


def test_an_archive_that_unpacks_to_more_than_the_memory_is_refused_before_it_does(tmp_path: Path) -> None:
    path = tmp_path / "bomb.npz"
    header = b"\x93NUMPY\x01\x00" + (118).to_bytes(2, "little")
    said = (
        json.dumps({"descr": "<i8", "fortran_order": False, "shape": None}).replace('"', "'").replace("false", "False")
    )
    text = said.replace("null", "(1099511627776,)").ljust(117) + "\n"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("t.npy", header + text.encode())
        for name in ("x", "y", "p"):
            archive.writestr(f"{name}.npy", header + text.encode())
    code = (
        "import resource, sys\n"
        "resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))\n"
        "from app.cli import main\n"
        "sys.exit(main(['info', sys.argv[1]]))"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code, str(path)], capture_output=True, text=True, timeout=PATIENCE_S, cwd=ROOT
    )
    assert ended.returncode == 2 and ended.stderr.count("\n") == 1, ended.stderr[-500:]
