"""The directory of a run: config, status, control and results. Nothing here needs torch.

runs/<name>/config.toml       the whole configuration
            versions.json     versions of what computed it
            status.json       how the process is doing, a few times a second
            control.json      what a person wants it to do: run, pause, stop, how fast
            seed-<n>/metrics.jsonl      one line per episode
                     evaluations.jsonl  one line per checkpoint: the policy on the fixed balls
                     checkpoint.safetensors   everything to go on from, bit for bit
                     policies/<episode>.safetensors   the policy at each checkpoint, 0: before the first ball
                     policy.safetensors, best.safetensors   the last, and the best by other balls than the evaluations'
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final, Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from core import files
from core.config import load_config, save_config
from core.errors import WRITE_REMEDY, ConfigError
from core.files import read_json, replace_file, write_json
from core.learning.agents.agent import Agent
from core.learning.agents.policy import Policy, read_policy
from core.learning.agents.replay import ReplayBuffer
from core.learning.config import RunConfig
from core.text import parse_json

RunCommand = Literal["run", "pause", "stop"]
State = Literal["running", "paused", "stopped", "finished", "failed"]
PACKAGES = ("rallyscope", "numpy", "numba", "torch", "mujoco", "gymnasium", "stable-baselines3", "sb3-contrib")


@dataclass(frozen=True, slots=True)
class SeedFiles:
    """Paths of one seed."""

    folder: Path

    @property
    def metrics(self) -> Path:
        """One line per episode."""
        return self.folder / "metrics.jsonl"

    @property
    def evaluations(self) -> Path:
        """One line per checkpoint."""
        return self.folder / "evaluations.jsonl"

    @property
    def checkpoint(self) -> Path:
        """Checkpoint to resume from."""
        return self.folder / "checkpoint.safetensors"

    @property
    def policy(self) -> Path:
        """The file of the last policy."""
        return self.folder / "policy.safetensors"

    @property
    def best(self) -> Path:
        """Best policy at the last speed, by validation balls."""
        return self.folder / "best.safetensors"

    def policy_at(self, episode: int) -> Path:
        """The policy of a checkpoint."""
        return self.folder / "policies" / f"{episode:06d}.safetensors"

    def kept_policies(self) -> tuple[tuple[int, Path], ...]:
        """Episodes played and file of each policy that was kept, in order."""
        paths = (self.folder / "policies").glob("*.safetensors")
        return tuple(sorted((int(path.stem), path) for path in paths if path.stem.isdecimal()))


def seed_files(run: Path, seed: int) -> SeedFiles:
    """The files of one seed of a run."""
    return SeedFiles(run / f"seed-{seed}")


def seeds_of(run: Path) -> tuple[int, ...]:
    """The seeds that have a policy."""
    found = [path.parent.name.removeprefix("seed-") for path in run.glob("seed-*/policy.safetensors")]
    return tuple(sorted(int(name) for name in found if name.isdecimal()))


def create_run(run: Path, config: RunConfig) -> None:
    """Make the folder of a new run.

    Raises:
        ConfigError: if there is one already, or the folder cannot be made.
    """
    if (run / "config.toml").exists():
        raise ConfigError("there is a run already", where=run, remedy="resume it, or take another name")
    try:
        write_json(run / "versions.json", _versions())
    except OSError as error:
        raise ConfigError("the run cannot be written", got=error.strerror, where=run, remedy=WRITE_REMEDY) from error
    save_config(config, run / "config.toml")  # last: it makes the folder a run


def read_run(run: Path) -> RunConfig:
    """The configuration of a run.

    Raises:
        ConfigError: if the folder holds no run.
    """
    if not (run / "config.toml").is_file():
        raise ConfigError("not a training run", expected="a folder with config.toml", where=run)
    return load_config(RunConfig, run / "config.toml")


def load_policy(run: Path, seed: int | None = None, which: Literal["last", "best"] = "last") -> Policy:
    """A trained policy: of a seed of a run (its first by default), last or best.

    Raises:
        ConfigError: if there is none.
    """
    if seed is None:
        seeds = seeds_of(run)
        if not seeds:
            raise ConfigError("a run without a policy", where=run, remedy="train it first")
        seed = seeds[0]
    one = seed_files(run, seed)
    return read_policy(one.best if which == "best" else one.policy)


def read_lines(path: Path, start_byte: int = 0) -> tuple[list[dict[str, object]], int]:
    """Complete lines of a growing .jsonl file from a byte on, and the byte to go on from.

    Raises:
        ConfigError: if a line is not what a run writes.
    """
    try:
        with path.open("rb") as file:
            file.seek(start_byte)
            data = file.read()
    except OSError:
        return [], start_byte
    end = data.rfind(b"\n") + 1
    return [_parse_line(line, path) for line in data[:end].split(b"\n")[:-1]], start_byte + end


def _parse_line(line: bytes, path: Path) -> dict[str, object]:
    try:
        values = parse_json(line)
    except ValueError as error:
        raise ConfigError("a broken line", got=error, where=path) from error
    if not isinstance(values, dict):
        raise ConfigError("a broken line", expected="named values", got=type(values).__name__, where=path)
    return values


class SeedWriter:
    """Appends the lines of a seed; a line that is not in a checkpoint yet may be lost in a kill, and is made again."""

    def __init__(self, seed: SeedFiles) -> None:
        self._metrics = seed.metrics.open("ab")
        self._evaluations = seed.evaluations.open("ab")

    def __enter__(self) -> SeedWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self._metrics.close()
        self._evaluations.close()

    def metrics(self, line: dict[str, object]) -> None:
        """One episode."""
        self._metrics.write(json.dumps(line).encode() + b"\n")

    def evaluation(self, line: dict[str, object]) -> None:
        """One checkpoint."""
        self._evaluations.write(json.dumps(line).encode() + b"\n")
        self._evaluations.flush()

    def flush(self) -> None:
        """Flush both files to disk."""
        self._metrics.flush()

    def sizes(self) -> dict[str, object]:
        """Bytes of both files, on disk."""
        for file in (self._metrics, self._evaluations):
            file.flush()
            os.fsync(file.fileno())
        return {"metrics_bytes": self._metrics.tell(), "evaluations_bytes": self._evaluations.tell()}


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version(), "machine": platform.machine()}
    for name in PACKAGES:
        with contextlib.suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


AGENT: Final = "agent."
BUFFER: Final = "buffer."
"""Prefix of the buffer's arrays."""


def save_checkpoint(path: Path, arrays: dict[str, NDArray[np.generic]], about: dict[str, object]) -> None:
    """Write arrays and plain values atomically."""
    data = save({name: np.ascontiguousarray(a) for name, a in arrays.items()}, {"about": json.dumps(about)})
    replace_file(path, data, durable=True)


def pack_arrays(agent: Agent, buffer: ReplayBuffer) -> dict[str, NDArray[np.generic]]:
    """Arrays of agent and replay buffer, by their names in a checkpoint."""
    arrays: dict[str, NDArray[np.generic]] = {f"{AGENT}{name}": array for name, array in agent.to_arrays().items()}
    return arrays | {f"{BUFFER}{name}": array for name, array in buffer.to_arrays().items()}


def restore_arrays(arrays: dict[str, NDArray[np.generic]], agent: Agent, buffer: ReplayBuffer) -> None:
    """Load what `pack_arrays` gave.

    Raises:
        KeyError, ValueError, TypeError, RuntimeError: if they are another agent's.
    """
    agent.restore({k.removeprefix(AGENT): v for k, v in arrays.items() if k.startswith(AGENT)})
    balls = {k.removeprefix(BUFFER): v for k, v in arrays.items() if k.startswith(BUFFER)}
    buffer.restore(balls)  # type: ignore[arg-type]


def load_checkpoint(path: Path) -> tuple[dict[str, NDArray[np.generic]], dict[str, object]]:
    """Load a checkpoint that `save_checkpoint` wrote.

    Raises:
        ConfigError: if the file is not one.
    """
    try:
        with safe_open(path, "np") as file:
            about = parse_json((file.metadata() or {})["about"])
            return {name: file.get_tensor(name) for name in file.keys()}, about  # noqa: SIM118 - not a mapping
    except (OSError, SafetensorError, KeyError, ValueError) as error:
        raise ConfigError("not a checkpoint", got=str(error), where=path, remedy="delete it to start over") from error


@dataclass(frozen=True, slots=True)
class Control:
    """Command to a training process."""

    command: RunCommand = "run"
    episodes_per_s: float | None = None
    """Speed limit, episodes/s; None: unlimited."""


@dataclass(frozen=True, slots=True)
class RunStatus:
    """Status of a training process."""

    state: State
    pid: int
    seed: int
    episode: int
    """Episodes done in this seed."""
    episodes: int
    """Most episodes of one seed."""
    share: float
    """Share of the whole run, all seeds, that is done, 0..1."""
    speed_mps: float
    seconds_left: float | None
    message: str = ""


def hold_run(run: Path) -> contextlib.AbstractContextManager[object]:
    """Lock the run for this process.

    Raises:
        ConfigError: if another one does.
    """
    try:
        return files.hold(run / ".lock")
    except TimeoutError as error:
        raise ConfigError("another process is training this run", where=run) from error
    except OSError as error:
        remedy = "make its folder writable, or train a copy of it"
        raise ConfigError("the run cannot be written", got=error.strerror, where=run, remedy=remedy) from error


def is_held(run: Path) -> bool:
    """Whether a process trains this run now; a number of a process alone may be another's after a restart."""
    return files.is_held(run / ".lock")


def write_control(run: Path, control: Control) -> None:
    """Command the training process to continue, pause, stop or slow down; it checks before every episode."""
    write_json(run / "control.json", {"wish": control.command, "episodes_per_s": control.episodes_per_s})


def read_control(run: Path) -> Control:
    """Current command; continue if there is none, or an invalid one."""
    found = read_json(run / "control.json")
    command, rate = found.get("wish"), found.get("episodes_per_s")
    wanted: RunCommand = "pause" if command == "pause" else "stop" if command == "stop" else "run"
    return Control(wanted, float(rate) if isinstance(rate, (int, float)) and 0 < rate < 1e9 else None)


def write_status(run: Path, status: RunStatus) -> None:
    """Write the status."""
    write_json(run / "status.json", dataclasses.asdict(status))


def read_status(run: Path) -> RunStatus | None:
    """Status of a run; None before the first. A process that died is `failed`, whatever its last status."""
    found = read_json(run / "status.json")
    if not _is_status(found):
        return None
    status = RunStatus(**found)  # type: ignore[arg-type]
    alive = _is_alive(status.pid) if files.POSIX else is_held(run)  # to ask for a process may end it on Windows
    if status.state in ("running", "paused") and not alive:
        return dataclasses.replace(status, state="failed", message=status.message or "the process ended unexpectedly")
    return status


def _is_status(found: Mapping[str, object]) -> bool:
    """Whether every value is there and of its kind: the file may be damaged."""
    whole, real = ("pid", "seed", "episode", "episodes"), ("share", "speed_mps", "seconds_left")
    names = {field.name for field in dataclasses.fields(RunStatus)}
    return (
        names - {"message"} <= found.keys() <= names
        and found["state"] in get_args(State)
        and all(type(found[name]) is int and 0 <= cast(int, found[name]) < 2**31 for name in whole)
        and all(type(found[name]) in (int, float) or (name == "seconds_left" and found[name] is None) for name in real)
        and isinstance(found.get("message", ""), str)
    )


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
