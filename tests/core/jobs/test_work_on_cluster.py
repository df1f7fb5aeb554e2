"""What the verbs send to a cluster comes back as if it had been done here."""

import hashlib
import json
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from app.cli import main
from benchmarks.learning.plan import Counts, plan
from benchmarks.learning.runs import train_seed
from benchmarks.perception.bench_paper_perception import run_seed
from benchmarks.perception.results import METHODS
from core.data_sets import plan_data_set, run_data_set
from core.data_sets.plan import DataSetPlan, Making, PlannedRecording
from core.data_sets.run import LOCK
from core.errors import JobsError
from core.events import SensorSize
from core.jobs import ALONE, JobBackend, open_jobs
from core.learning import create_run, default_run, run_training
from core.learning.config import CurriculumConfig
from core.recordings import open_recording
from labels.model import Label, LabelState
from labels.store import LabelStore

pytest.importorskip("distributed")
SMALL = Making(sensor=SensorSize(48, 32))
PLAN = plan_data_set(speeds_mps=(8, 9), serves=1, robot=False, making=SMALL)


def digests(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir() if path.name != LOCK}


@pytest.mark.gate
def test_a_data_set_is_the_same_byte_for_byte_and_goes_on_wherever_it_was_begun(cluster, tmp_path: Path) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    engine = JobBackend(cluster=cluster.address)
    run_data_set(PLAN, here, engine=ALONE)
    begun = replace(PLAN, recordings=PLAN.recordings[:1])
    assert run_data_set(begun, there, engine=ALONE).made == (PLAN.recordings[0].name,)
    shares: list[float] = []
    done = run_data_set(PLAN, there, engine=engine, progress=shares.append)
    assert done.kept == (PLAN.recordings[0].name,) and done.made == (PLAN.recordings[1].name,)
    assert digests(here) == digests(there) and len(digests(here)) == 6
    assert shares == sorted(shares) and shares[-1] == 1.0


def test_when_nobody_answers_the_data_set_stays_as_it_is(free_port: int, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("core.jobs.cluster.CONNECT_S", 0.5)
    engine = JobBackend(cluster=f"tcp://127.0.0.1:{free_port}")
    with pytest.raises(JobsError, match="no scheduler"):
        run_data_set(PLAN, tmp_path, engine=engine)
    assert not list(tmp_path.glob("*.h5")) and not list(tmp_path.glob(".*partial*"))


def test_a_trained_seed_is_the_same_to_the_last_bit_but_for_its_time(cluster) -> None:
    counts = Counts(seeds=2, minor_seeds=1, balls=10, shorten=100)
    experiment = next(one for one in plan(counts) if one.name == "model-5")
    answers = []
    for engine in (ALONE, JobBackend(cluster=cluster.address)):
        with open_jobs(engine, 2) as jobs:
            answers.append(jobs.run(train_seed, [(experiment, 0), (experiment, 1)]))
    for answer in (*answers[0], *answers[1]):
        assert answer.pop("cpu_s")
    assert answers[0] == answers[1] and answers[0][0] != answers[0][1]


def test_the_seeds_of_a_run_are_the_same_to_the_last_byte(cluster, tmp_path: Path) -> None:
    config = replace(default_run("landing-model"), seeds=2, checkpoint_every=10, evaluation_balls=10)
    short = CurriculumConfig(speeds_mps=(5.0,), episodes=(20,))
    config = replace(config, curriculum=short, environment=replace(config.environment, state_source="truth"))
    found = []
    for name, engine in (("here", ALONE), ("there", JobBackend(cluster=cluster.address))):
        create_run(tmp_path / name, config)
        assert run_training(tmp_path / name, engine=engine) == "finished"
        folders = sorted(path for path in (tmp_path / name).glob("seed-*/**/*") if path.is_file())
        found.append({str(path.relative_to(tmp_path / name)): path.read_bytes() for path in folders})
    assert found[0] == found[1] and {"seed-0/policy.safetensors", "seed-1/metrics.jsonl"} <= found[0].keys()


def test_what_methods_find_is_measured_there_and_only_their_times_differ(cluster, tmp_path: Path) -> None:
    flight = PlannedRecording(
        name="flight",
        scene="ball",
        placement="side",
        speeds_mps=(9.0,),
        robot=False,
        seed=3,
        making=Making(sensor=SensorSize(320, 180)),
    )
    planned, seed = DataSetPlan("one flight", 3, (flight,)), 3
    found = []
    for name, engine in (("here", ALONE), ("there", JobBackend(cluster=cluster.address))):
        run = run_seed(planned, tmp_path / name, lambda share: None, with_recordings=False, engine=engine)
        # The newest answer at a time depends on what each step took, too.
        found.append([replace(one, cpu_ms=(), age_ms=(), held_px=(), moved_px=()) for one in run.results])
        assert all(result.cpu_ms for result in run.results) and run.seed == seed
    assert found[0] == found[1] and [result.method for result in found[0]] == list(METHODS)


def test_recordings_are_looked_at_by_the_workers_and_the_tables_are_written_here(cluster, tmp_path: Path) -> None:
    made = tmp_path / "made"
    run_data_set(PLAN, made, engine=ALONE)
    recordings = sorted(map(str, made.glob("*.h5")))
    arguments = ["detect", *recordings, "--camera", "left"]
    assert main([*arguments, "--out", str(tmp_path / "here"), "--jobs", "1"]) == 0
    assert main([*arguments, "--out", str(tmp_path / "there"), "--cluster", cluster.address]) == 0
    assert digests(tmp_path / "here") == digests(tmp_path / "there") and len(recordings) == 2


def test_recordings_are_scored_by_the_workers_against_labels_that_are_sent_to_them(
    cluster, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made, data = tmp_path / "made", tmp_path / "data"
    run_data_set(PLAN, made, engine=ALONE)
    recordings = sorted(map(str, made.glob("*.h5")))
    for number, path in enumerate(recordings):
        with closing(open_recording(path)) as recording:
            uuid = recording.uuid
        with LabelStore.open(data / "labels", uuid, "left", "anna") as store:
            store.put(Label(t_us=20_000 + 2000 * number, state=LabelState.NO_BALL))
    arguments = ["labels", "score", *recordings, "--camera", "left", "--data", str(data), "--json"]
    capsys.readouterr()
    told = []
    for where in (["--jobs", "1"], ["--cluster", cluster.address]):
        assert main([*arguments, *where]) == 0
        told.append(json.loads(capsys.readouterr().out))
    assert told[0] == told[1] and told[0]["rows"][0]["labels"] == len(recordings) == 2
