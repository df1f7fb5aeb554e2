"""`rallyscope train`: train an agent, or go on with a run that was stopped or killed."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from app.cli.arguments import Counts, Numbers, PositiveInt, flag, given, setting_flag
from app.cli.backend_arguments import SharedBackendArguments
from app.cli.constants import CONSTANTS_HELP, given_constants
from app.cli.ending import end_event
from app.cli.episode_backends import open_backend
from app.cli.progress import progress_bar
from app.cli.randomise_argument import RANDOMISE_HELP, RANDOMISE_METAVAR, RandomisedNames, randomised
from app.cli.terminal import say
from core.config import load_config
from core.errors import CommandError
from core.extras import require_package
from core.jobs import ALONE, JobBackend
from core.learning.config import (
    CurriculumConfig,
    EnvironmentConfig,
    HeadName,
    LandingModelConfig,
    OutcomeSource,
    RacketSpeedRule,
    ReplayRule,
    RunConfig,
    SimulatorName,
    StateKind,
    StateSource,
    default_run,
    environment_profile,
    spinning_environment,
)
from core.learning.evaluation.reachable import reachable_words
from core.learning.registered_agents import AgentName
from core.learning.rewards import RewardConfig, RewardKind
from core.learning.runs.named_runs import NAMED_RUNS, PresetName
from core.learning.runs.run_files import create_run, read_run, seed_files
from core.learning.task.recorded_balls import ball_state_files
from core.physics.config import Profile
from core.physics.task import HitRule

BALLS_BEFORE_CAMERAS = 100
"""Fixed balls of an evaluation with states from events: each takes a second to be seen, once per training."""

BALLS_PLAYED_OUT = 10
"""Balls of an evaluation where cameras see the outcomes too: each is served, struck and watched to its end."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NewRunArguments:
    """What describes a new run, and so cannot stand beside --resume."""

    config: Path | None = flag("a config.toml; other options change it", "FILE")
    preset: PresetName | None = flag(
        "a named run: the paper's, its rules with changes of ours, or ours for placing alone without its rules."
        " Other options change it, but for --agent and --config"
    )
    agent: AgentName | None = setting_flag(
        RunConfig, "agent", what="learning algorithm; the defaults below are those of ddpg, the paper's"
    )
    head: HeadName | None = setting_flag(LandingModelConfig, "head", what="what the landing model learns")
    speeds: Numbers | None = flag("curriculum: serve speeds in m/s, 3 to 9", "3,5")
    episodes: Counts | None = flag("episodes per stage, or one number for all stages", "800,900")
    advance: Literal["episodes", "converged"] | None = setting_flag(CurriculumConfig, "advance")
    reward: RewardKind | None = setting_flag(RewardConfig, "kind", what="reward per ball")
    replay: ReplayRule | None = setting_flag(CurriculumConfig, "replay")
    seeds: PositiveInt | None = setting_flag(RunConfig, "seeds", "N")
    first_seed: int | None = setting_flag(RunConfig, "first_seed", "N")
    state_source: StateSource | None = setting_flag(EnvironmentConfig, "state_source")
    state: StateKind | None = setting_flag(
        EnvironmentConfig, "state", what="what the policy sees of a ball: p_c and v_c, or also spin and its uncertainty"
    )
    racket: RacketSpeedRule | None = setting_flag(
        EnvironmentConfig,
        "racket",
        what="racket speed: derived from the ball's, or chosen per ball (landing-model); `uncertain`: derived, with"
        " angles and speed off by what is drawn for each ball",
    )
    hit: HitRule | None = setting_flag(
        EnvironmentConfig, "hit", what="where balls are met: always at the plane, or chosen along the flight"
    )
    randomise: RandomisedNames | None = flag(RANDOMISE_HELP, RANDOMISE_METAVAR, "none")
    balls: str | None = flag(
        "drawn serves; the same with spin, up to 100 rad/s about each axis; or recorded ball states, a file or a folder"
        " of them, of which a fifth is kept for the evaluation (the last two: physics `real` unless told otherwise)",
        "serves|spinning|PATH",
        "serves",
    )
    outcomes: OutcomeSource | None = setting_flag(
        EnvironmentConfig, "outcomes", what="source of a stroke's outcome; `events` goes with states from events"
    )
    simulator: SimulatorName | None = setting_flag(
        EnvironmentConfig, "engine", what="what plays serves and strokes: closed form, or MuJoCo as in the live rally"
    )
    physics: Profile | None = flag("how balls fly and bounce", default="paper")
    constants: Path | None = flag(CONSTANTS_HELP, "FILE")
    serves: Literal["standard", "hard"] | None = flag("which serves", default="standard")


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainArguments:
    """Train a policy, or go on with a run that was stopped or killed."""

    out: Path = flag("folder of the run", "RUN")
    resume: bool = flag("resume the run in that folder")
    new: NewRunArguments
    source: str | None = flag(
        "play every ball in a simulation server (its outcomes are the same; --outcomes events takes only its events)",
        "tcp://HOST:PORT",
    )
    keys: Path | None = flag("folder with the client's keys, for a source on another machine", "DIR")
    engine: SharedBackendArguments
    json: bool = flag("print a summary as JSON")


def run(arguments: TrainArguments) -> None:
    """Train until the end, or until interrupted: then the run can be resumed."""
    require_package("torch", "training")
    folder, engine = arguments.out, _engine(arguments)
    if arguments.resume:
        if options := given(dataclasses.asdict(arguments.new)):
            names = ", ".join("--" + name.replace("_", "-") for name in options)
            raise CommandError("a resumed run keeps its settings", got=names, remedy="leave them out")
        config = read_run(folder)
    else:
        config = requested_run(arguments.new)
    if config.environment.engine == "mujoco":
        require_package("mujoco", "--simulator mujoco")
        if arguments.source is not None:
            raise CommandError("a server plays the strokes itself", got="--source", remedy="leave out --simulator")
    with open_backend(config, arguments.source, arguments.keys) as backend:
        if not arguments.resume:
            create_run(folder, config)
        from core.learning.runs.running import run_training  # late: torch takes a second, a mistake should not

        if not arguments.json:
            _tell_bounds(config)
        ended = end_event()
        with progress_bar(f"Training {config.agent}") as progress:
            state = run_training(folder, progress=progress, stopped=ended.is_set, backend=backend, engine=engine)
    _report(folder, config, state, as_json=arguments.json)


def _tell_bounds(config: RunConfig) -> None:
    """Where the racket's bounds limit what can be returned, say so before."""
    for words in reachable_words(config.environment, config.curriculum.speeds_mps):
        say(words)


def _engine(arguments: TrainArguments) -> JobBackend:
    """Where seeds are trained; those that share a simulation server take turns."""
    asked = given({"jobs": arguments.engine.jobs, "cluster": arguments.engine.cluster})
    if arguments.source is None:
        return arguments.engine.engine()
    for name in asked:
        remedy = "leave out one of the two"
        raise CommandError("a simulation server plays one seed at a time", where=f"--{name}", remedy=remedy)
    return ALONE


def requested_run(arguments: NewRunArguments) -> RunConfig:
    """The run that the options describe."""
    config = _begun_with(arguments)
    environment, outcomes = config.environment, arguments.outcomes or config.environment.outcomes
    source = "events" if arguments.outcomes == "events" else environment.state_source
    balls, state = arguments.balls or "serves", arguments.state or environment.state
    recorded = environment.recorded if arguments.balls is None else _recorded(balls)
    if source == "predicted" and (state == "spin" or recorded):
        source = "truth"  # the paper's prediction knows of neither
    state_source = arguments.state_source or source
    other_balls = balls != "serves" and not arguments.config
    constants = given_constants(arguments.constants, arguments.physics)
    if arguments.physics or arguments.serves or other_balls or constants:
        physics, serves = arguments.physics or ("real" if other_balls else "paper"), arguments.serves or "standard"
        environment = environment_profile(physics, serves=serves, state_source=state_source, constants=constants)
    if balls == "spinning":
        environment = spinning_environment(environment)
    if recorded and (arguments.speeds or arguments.serves):
        given_twice = "--speeds" if arguments.speeds else "--serves"
        raise CommandError("recorded balls come as they were struck", got=given_twice, remedy="leave it out")
    before_cameras = {"told": BALLS_BEFORE_CAMERAS, "events": BALLS_PLAYED_OUT}[outcomes]
    few = state_source == "events" and not arguments.config
    return dataclasses.replace(
        config,
        environment=dataclasses.replace(
            environment,
            state_source=state_source,
            outcomes=outcomes,
            state=state,
            recorded=recorded,
            racket=arguments.racket or config.environment.racket,
            hit=arguments.hit or config.environment.hit,
            engine=arguments.simulator or config.environment.engine,
            randomise=randomised(config.environment.randomise, arguments.randomise, constants),
        ),
        evaluation_balls=before_cameras if few else config.evaluation_balls,
        landing_model=dataclasses.replace(config.landing_model, **given({"head": arguments.head})),
        reward=dataclasses.replace(config.reward, **given({"kind": arguments.reward})),
        curriculum=_curriculum(_one_stage(config.curriculum) if recorded else config.curriculum, arguments),
        **given({"agent": arguments.agent, "seeds": arguments.seeds, "first_seed": arguments.first_seed}),
    )


def _begun_with(arguments: NewRunArguments) -> RunConfig:
    """The run that the other options change: a file's, a named one, or the agent's default.

    Raises:
        CommandError: if a preset, which has an agent and every setting, stands beside an agent or a file.
    """
    if arguments.preset is not None:
        for name, other in (("agent", arguments.agent), ("config", arguments.config)):
            if other is not None:
                raise CommandError("a preset is a whole run", got=f"--{name}", remedy="leave out one of the two")
        return NAMED_RUNS[arguments.preset]
    return load_config(RunConfig, arguments.config) if arguments.config else default_run(arguments.agent or "ddpg")


def _recorded(balls: str) -> str:
    """The absolute path of recorded balls, so that a run finds them again; empty for serves.

    Raises:
        ConfigError: if there are none.
    """
    if balls in ("serves", "spinning"):
        return ""
    ball_state_files(balls)
    return str(Path(balls).resolve())


def _one_stage(curriculum: CurriculumConfig) -> CurriculumConfig:
    """Recorded balls have no stages of speed: the last stage, as long as all of them."""
    stage = {"speeds_mps": curriculum.speeds_mps[-1:], "episodes": (sum(curriculum.episodes),)}
    return dataclasses.replace(curriculum, **stage)


def _curriculum(curriculum: CurriculumConfig, arguments: NewRunArguments) -> CurriculumConfig:
    speeds = arguments.speeds or curriculum.speeds_mps
    episodes = arguments.episodes or curriculum.episodes
    if len(episodes) == 1:
        episodes *= len(speeds)
    elif arguments.episodes is None and len(speeds) != len(episodes):
        # Another number of stages: the first stage as long as usual, all others as the usual last one.
        episodes = (episodes[0],) + (episodes[-1],) * (len(speeds) - 1)
    rules = given({"advance": arguments.advance, "replay": arguments.replay})
    return dataclasses.replace(curriculum, speeds_mps=speeds, episodes=episodes, **rules)


def _report(folder: Path, config: RunConfig, state: str, *, as_json: bool) -> None:
    from core.learning.runs.run_files import read_lines

    last = []
    for seed in range(config.first_seed, config.first_seed + config.seeds):
        lines, _ = read_lines(seed_files(folder, seed).evaluations)
        last += [{"seed": seed, **lines[-1]}] if lines else []
    if as_json:
        say(json.dumps({"run": str(folder), "state": state, "seeds": last}))
        return
    say(f"{state}: {folder}" + ("" if state == "finished" else "   (continue with --resume)"))
    for line in last:
        error = line["error_mm"]
        shown = "-" if error is None else f"{error:.0f} mm from the target"
        balls = "of the recorded balls" if config.environment.recorded else f"at {line['speed_mps']:g} m/s"
        say(f"seed {line['seed']}: {100 * line['returned']:.1f} % returned {balls}, {shown}")
