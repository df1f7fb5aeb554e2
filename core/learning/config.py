"""Settings of a training run: the task, the agent, the reward, the replay rule, the curriculum.

What the paper leaves open is a field here, with our choice as its default; the whole of it lands in the run's folder.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Final, Literal

from core.config import Sections, check_settings, choice, normal_sections, open_sections, setting
from core.errors import ConfigError
from core.learning.randomisation import RandomisationConfig
from core.learning.registered_agents import AGENTS, AgentName, agent_section
from core.learning.rewards import RewardConfig
from core.physics.config import Profile
from core.physics.constants_file import FittedConstants
from core.physics.task import HitRule, TaskConfig, hard_serves, task_profile

StateSource = Literal["predicted", "truth", "truth+noise", "timed", "events"]
StateKind = Literal["plain", "spin"]
SimulatorName = Literal["closed-form", "mujoco"]
RacketSpeedRule = Literal["table", "chosen", "uncertain"]
OutcomeSource = Literal["told", "events"]
CHOSEN_MPS: Final = (0.0, 4.5)
"""Range of racket speeds along +x that a policy can choose; the built-in controller's is -2.5 to 4.5."""
SPINNING_RADPS: Final = 100.0
"""Largest spin about each axis of spinning serves."""
ReplayRule = Literal["threshold", "discard", "retain"]
HeadName = Literal["free", "flight", "impact", "process", "reflection"]
WITHOUT_NETWORKS: Final[tuple[HeadName, ...]] = ("process", "reflection")


@dataclass(frozen=True, slots=True, kw_only=True)
class GoalConfig:
    """Where the ball is to land, in the table's plane (choice; the paper does not say how its targets are spread)."""

    kind: Literal["random", "fixed"] = "random"
    """A new uniform target per ball in the box below, or always the box's centre."""
    low_x_m: float = setting(0.45, 0.0, 1.37)
    high_x_m: float = setting(1.10, 0.0, 1.37)
    half_width_m: float = setting(0.45, 0.0, 0.76)
    """The box reaches this far to both sides of the centre line."""

    def __post_init__(self) -> None:
        check_settings(self)
        if self.low_x_m > self.high_x_m:
            raise ConfigError("an empty target box", expected="low_x_m <= high_x_m", got=self.low_x_m, where="goal")

    @property
    def centre_m(self) -> tuple[float, float]:
        """The middle of the box."""
        return (self.low_x_m + self.high_x_m) / 2, 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TimingConfig:
    """Timing and point errors of a modelled perception by event cameras, without rendering."""

    predictor: Literal["filter", "paper"] = "filter"
    """The chain's filter, or the paper's five points; both detect the bounce."""
    window_ms: float = setting(2.0, 0.5, 10.0)
    """Interval between two points."""
    block_ms: float = setting(10.0, 1.0, 50.0)
    """Points are available at the end of a block of this length: the delay of perception."""
    lead_ms: float = setting(50.0, 10.0, 200.0)
    """The stroke is decided at the first block with less time than this left until the ball arrives."""
    first_seen_ms: float = setting(18.0, 0.0, 200.0)
    """A ball is first seen this long after the launch (measured on simulated serves, as what follows)."""
    seen_from_x_m: float = setting(1.12, -1.4, 3.0)
    """A ball is seen only nearer to the robot than this: the cameras' field of view."""
    error_scale: float = setting(1.0, 0.0, 50.0)
    """Factor on the measured errors of points (`point_errors.MEASURED`)."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class EnvironmentConfig:
    """Settings of an episode: one serve, its perception, one racket orientation, one outcome."""

    task: TaskConfig = field(default_factory=TaskConfig)
    goal: GoalConfig = field(default_factory=GoalConfig)
    state_source: StateSource = "predicted"
    """How the learner gets p_c and v_c: the paper's five-point prediction, the truth, the truth with noise, points that
    err as those of event cameras until the decision, or the whole chain of event cameras. Except for `truth`, the
    racket goes where the ball is expected and may miss it."""
    state: StateKind = "plain"
    """State of a ball for the learner: p_c and v_c as in the paper, or with them the estimated spin and its standard
    deviations."""
    outcomes: OutcomeSource = "told"
    """Source of the outcome of a stroke and the serve's speed: the simulation, or with states from `events` the cameras
    themselves."""
    position_noise_m: float = setting(0.005, 0.0, 0.1)
    """Standard deviation per axis of `truth+noise`."""
    velocity_noise: float = setting(0.01, 0.0, 0.2)
    """Standard deviation per axis of `truth+noise`, as a share of the speed."""
    hit: HitRule = "paper"
    """Where balls are met: at the task's plane as in the paper, or where each can best be met along its flight, as in
    the live rally. Place and time then follow from the flight; the action is the orientation as before."""
    racket: RacketSpeedRule = "table"
    """Speed of the racket towards a ball: by the task's table for the ball's speed, as in the paper's task; chosen for
    every ball as a fourth part of the action; or the table's with a racket that does not quite do as it is told
    (`uncertain`)."""
    spin_noise_radps: float = setting(10.0, 0.0, 200.0)
    """Spin noise of `truth+noise` with the state `spin`: each ball's standard deviation per axis is drawn up to twice
    this."""
    timing: TimingConfig = field(default_factory=TimingConfig)
    """Settings of the state source `timed`."""
    recorded: str = ""
    """A file of recorded ball states, or a folder of such files, to take the balls from; empty: serves are drawn."""
    actuator_error_deg: float = setting(0.0, 0.0, 5.0)
    """Standard deviation of each angle's actuator error, redrawn per stroke; unknown to the learner."""
    actuator_bias_deg: float = setting(0.0, -5.0, 5.0)
    """Constant error of every angle."""
    engine: SimulatorName = "closed-form"
    """Which simulator plays the strokes; both give the same outcomes."""
    step_s: float = setting(0.01, 0.0005, 0.05)
    """Time step of the simulation (paper: 10 ms in training): the grid of the observations, and MuJoCo's step."""
    randomise: RandomisationConfig = field(default_factory=RandomisationConfig)
    """What differs from ball to ball, unknown to the learner."""

    def __post_init__(self) -> None:
        check_settings(self)
        if self.outcomes == "events" and self.state_source != "events":
            raise ConfigError(
                "outcomes that cameras see need states that they see",
                expected='state_source "events"',
                got=self.state_source,
                where="outcomes",
                remedy="train with --state-source events",
            )
        if self.state == "spin" and self.state_source == "predicted":
            raise ConfigError(
                "the paper's five points tell no spin",
                expected="another state source with the state spin",
                where="state",
                remedy="train with --state-source truth, truth+noise, timed or events",
            )
        if self.state == "spin" and self.state_source == "timed" and self.timing.predictor == "paper":
            raise ConfigError("the paper's five points tell no spin", expected='predictor "filter"', where="timing")
        # Those sources fly the serve again from its launch, which a recorded ball does not have.
        if self.recorded and (self.state_source in ("predicted", "timed") or self.outcomes == "events"):
            raise ConfigError(
                "recorded balls are not seen so",
                expected='state_source "truth", "truth+noise" or "events", and outcomes that are told',
                got=f"{self.state_source}, outcomes {self.outcomes}",
                where="recorded",
            )
        names = ", ".join(self.randomise.names)
        if names and self.state_source == "events":
            remedy = "take another state source, or leave it out"
            raise ConfigError("cameras see one world", got=names, where="randomise", remedy=remedy)
        if self.recorded and self.randomise.physics:
            expected = "latency, rubber, calibration"
            raise ConfigError("recorded balls come as they flew", expected=expected, got=names, where="randomise")


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplorationConfig:
    """Noise on the action while training: N(0, eta), eta = max(smallest, scale decay^n), n the episode of a stage."""

    scale: float = setting(0.1, 0.0, 1.0)
    """Standard deviation in units of the action range [-1, 1] (choice)."""
    decay: float = setting(0.995, 0.9, 1.0)
    """Decay factor per episode (choice)."""
    smallest: float = setting(0.02, 0.0, 1.0)
    """eta_min (choice)."""
    random_episodes: int = setting(0, 0, 500)
    """Uniform random actions in the first episodes of a run: not in the paper, off by default."""

    def __post_init__(self) -> None:
        check_settings(self)

    def noise_at(self, n: int) -> float:
        """Standard deviation eta of the noise."""
        return max(self.smallest, self.scale * self.decay**n)


@dataclass(frozen=True, slots=True, kw_only=True)
class CurriculumConfig:
    """The curriculum: stages of rising serve speed."""

    speeds_mps: tuple[float, ...] = (3.0, 5.0)
    """One stage each (paper)."""
    episodes: tuple[int, ...] = (800, 900)
    """Episodes of each stage; the most of them if it advances on convergence (paper)."""
    advance: Literal["episodes", "converged"] = "episodes"
    """Advance after the stage's episodes, or as soon as enough balls are returned."""
    converged_rate: float = setting(0.98, 0.5, 1.0)
    """Return rate that ends a stage."""
    converged_window: int = setting(100, 10, 1000)
    """Number of episodes over which the rate is measured."""
    replay: ReplayRule = "threshold"
    """What a new stage keeps of the replay buffer: rewards of at least `keep_reward` (paper), nothing, everything."""
    keep_reward: float = setting(1.0, -10.0, 10.0)
    """delta: l_base keeps exactly the returned balls (choice)."""

    def __post_init__(self) -> None:
        check_settings(self)
        # Files give lists; a frozen value holds tuples.
        object.__setattr__(self, "speeds_mps", tuple(float(v) for v in self.speeds_mps))
        object.__setattr__(self, "episodes", tuple(self.episodes))
        if not self.speeds_mps or len(self.speeds_mps) != len(self.episodes):
            raise ConfigError(
                "not one number of episodes per speed",
                expected=f"{len(self.speeds_mps)} numbers",
                got=self.episodes,
                where="curriculum.episodes",
            )
        if not all(3.0 <= v <= 9.0 for v in self.speeds_mps):
            raise ConfigError("no serve of this speed", expected="3 to 9 m/s", got=self.speeds_mps, where="speeds")
        if not all(isinstance(n, int) and 1 <= n <= 1_000_000 for n in self.episodes):
            raise ConfigError(
                "not a number of episodes", expected="whole, above 0", got=self.episodes, where="episodes"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class DdpgConfig:
    """The paper's agent. Network sizes, rates, batch and updates per episode are open there."""

    hidden: int = setting(64, 8, 512)
    """Units of both hidden layers (choice)."""
    actor_rate: float = setting(3e-4, 1e-5, 1e-1)
    """Choice: a tenth of the critic's, as where DDPG was first published. At equal rates the actor runs after a critic
    that knows nothing yet into a corner of the action range, and in 2 of 20 seeds never comes out."""
    critic_rate: float = setting(3e-3, 1e-5, 1e-1)
    """Choice: faster loses nothing here, slower is less accurate at the same number of episodes."""
    batch: int = setting(64, 8, 1024)
    first_update: int = setting(32, 1, 1000)
    """Transitions in the buffer before the first update."""
    updates_per_episode: int = setting(4, 1, 64)
    """Choice: four learn reliably within the paper's episodes; two, with both rates at 0.001, have the pace of its
    learning curves."""
    target: Literal["terminal", "bootstrap"] = "terminal"
    """Critic's target: y = r, as an episode has one action, or the paper's equation with a discounted next value."""
    discount: float = setting(0.9, 0.0, 1.0)
    """Discount factor of `bootstrap`."""
    tau: float = setting(0.005, 0.0001, 1.0)
    """Share by which the target networks of `bootstrap` follow."""
    twin_critics: bool = False
    """Two critics, the lower one counts for the actor: not in the paper."""
    relabels: int = setting(0, 0, 16)
    """Extra copies of each batch with another goal and its recomputed reward: not in the paper."""
    rewards: Literal["stored", "current"] = "stored"
    """Rewards that the critic learns: as they were stored, or (ours) recomputed with the present weights, since CDTA
    gives the same stroke another reward at every episode."""
    final_rate: float = setting(1.0, 0.001, 1.0)
    """Share of both rates that is left at the end of a stage, approached exponentially; 1 is the paper's agent."""
    edge_penalty: float = setting(0.0, 0.0, 100.0)
    """Weight of a penalty that keeps the actor off the edge of the action range, where nothing can be learned: ours, 0
    is the paper's agent."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class LandingModelConfig:
    """The agent beyond the paper: its critic predicts where the ball lands and how high it crosses the net."""

    hidden: int = setting(64, 8, 512)
    actor_rate: float = setting(1e-3, 1e-5, 1e-1)
    critic_rate: float = setting(1e-3, 1e-5, 1e-1)
    final_rate: float = setting(1.0, 0.001, 1.0)
    """Share of both rates that is left at the end of a stage, approached exponentially."""
    batch: int = setting(64, 8, 1024)
    first_update: int = setting(8, 1, 1000)
    updates_per_episode: int = setting(32, 1, 256)
    """In the first `full_episodes` of a stage."""
    full_episodes: int = setting(100, 1, 100_000)
    """Episodes after which the updates fall as 1 / episode, down to `fewest_updates`."""
    fewest_updates: int = setting(4, 1, 256)
    net_margin_m: float = setting(0.02, 0.0, 0.3)
    """Predicted clearance over the net that the actor keeps."""
    net_weight: float = setting(4.0, 0.0, 50.0)
    """Metres of landing error that a metre of missing clearance counts for."""
    net_loss: float = setting(0.3, 0.0, 10.0)
    """Weight of the net height in the critic's loss."""
    head: HeadName = "free"
    """What the model's outputs are: landing and height at the net; the velocity after the stroke, from which gravity
    alone gives both; or restitution and grip of the rubber, from which the law of reflection gives that velocity.
    `process` and `reflection` have no networks, and their actor is solved for: a Gaussian process learns the velocity
    after the stroke, or the law of reflection is given and its numbers are fitted, for states that are noisy."""
    privileged: bool = False
    """Also learn from simulator-only data: where a ball would have landed without net and table."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sb3Config:
    """The agents of stable-baselines3, with their defaults but for what a batch of 1,700 one-step episodes demands."""

    exploration: Literal["default", "matched"] = "default"
    """`default` keeps the library's initial exploration; `matched` starts with the same noise as our agents."""
    hidden: int = setting(64, 8, 512)
    on_policy_steps: int = setting(50, 2, 2048)
    """Episodes between updates of PPO and TRPO: the default of 2,048 is more than a whole run."""
    updates_per_episode: int = setting(0, 0, 64)
    """Gradient steps per ball of TD3, SAC and (as passes over its balls) PPO; 0 is the library's pace: 1, 1 and 0.2."""
    rate: float = setting(0.0, 0.0, 1e-1)
    """Learning rate; 0 is the library's, or 0.001 with `matched` exploration."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunConfig:
    """Every setting of a training run."""

    agent: AgentName = choice("ddpg", AGENTS)
    environment: EnvironmentConfig = field(default_factory=EnvironmentConfig)
    reward: RewardConfig = field(default_factory=RewardConfig)
    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    curriculum: CurriculumConfig = field(default_factory=CurriculumConfig)
    ddpg: DdpgConfig = field(default_factory=DdpgConfig)
    landing_model: LandingModelConfig = field(default_factory=LandingModelConfig)
    rival: Sb3Config = field(default_factory=Sb3Config)
    seeds: int = setting(1, 1, 1000)
    """Independent repetitions."""
    first_seed: int = setting(0, 0, 2**31 - 1)
    """Number of the first repetition."""
    checkpoint_every: int = setting(50, 1, 100_000)
    """Episodes between checkpoints; each also evaluates the policy (paper: every 50)."""
    evaluation_balls: int = setting(500, 1, 100_000)
    """Fixed balls of an evaluation, the same for every run."""
    registered: Sections = open_sections(
        AGENTS.view(lambda one: one.config or object, where=lambda one: one.config is not None, key=agent_section)
    )
    """Settings of each agent of a plug-in that has some: a section of its name."""

    def __post_init__(self) -> None:
        check_settings(self)
        normal_sections(self)
        if self.environment.racket == "chosen" and not AGENTS[self.agent].chooses_racket_speed:
            can = ", ".join(name for name, one in AGENTS.items() if one.chooses_racket_speed)
            raise ConfigError("an agent of three angles", expected=can, got=self.agent, where='racket = "chosen"')
        plain = self.environment.racket != "chosen" and self.environment.state == "plain"
        if self.agent == "landing-model" and self.landing_model.head in WITHOUT_NETWORKS and not plain:
            raise ConfigError(
                f"the head {self.landing_model.head} knows no spin and chooses no racket speed",
                expected='a racket that is not chosen, and state = "plain"',
                got=f"{self.environment.racket}, {self.environment.state}",
                where="landing_model.head",
                remedy="take another head",
            )

    @property
    def episodes(self) -> int:
        """Episodes of all stages together, at most."""
        return sum(self.curriculum.episodes)


def agent_settings(config: RunConfig, agent: str) -> object:
    """The settings of an agent of a plug-in in a run's config, as they come where the run says nothing.

    Raises:
        KeyError: if there is no such agent.
    """
    own = AGENTS[agent].config
    return dict(config.registered).get(agent_section(agent)) or (own() if own is not None else None)


def environment_profile(
    physics: Profile = "paper",
    *,
    serves: Literal["standard", "hard"] = "standard",
    state_source: StateSource,
    constants: FittedConstants | None = None,
) -> EnvironmentConfig:
    """The environment with a named physics, or fitted constants of it, and a named distribution of serves."""
    task = task_profile(physics, constants)
    if serves == "hard":
        task = TaskConfig(physics=task.physics, serve=hard_serves(), stroke=task.stroke)
    return EnvironmentConfig(task=task, state_source=state_source)


def spinning_environment(environment: EnvironmentConfig, most_radps: float = SPINNING_RADPS) -> EnvironmentConfig:
    """The environment with spinning serves: each spin component uniform up to this, rad/s."""
    serve = dataclasses.replace(environment.task.serve, spin_spread_radps=most_radps)
    return dataclasses.replace(environment, task=dataclasses.replace(environment.task, serve=serve))


def default_run(agent: AgentName = "ddpg") -> RunConfig:
    """Default run of `rallyscope train --agent ...`: the paper's run for its agent, and for all
    others 5 m/s with the true state, which compares them.
    """
    if agent == "ddpg":
        return RunConfig()
    truth = EnvironmentConfig(state_source="truth")
    if agent == "landing-model":
        return RunConfig(
            agent=agent,
            environment=truth,
            exploration=ExplorationConfig(random_episodes=10),
            curriculum=CurriculumConfig(speeds_mps=(5.0,), episodes=(300,), replay="retain"),
        )
    return RunConfig(
        agent=agent,
        environment=truth,
        reward=RewardConfig(kind="case"),
        curriculum=CurriculumConfig(speeds_mps=(5.0,), episodes=(1700,), replay="retain"),
    )
