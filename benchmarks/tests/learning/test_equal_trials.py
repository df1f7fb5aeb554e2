"""Every agent is tuned alike: the same draws, as many steps, and the trial with the lowest error is taken."""

from pathlib import Path

import pytest

from benchmarks.learning import equal_trials
from benchmarks.learning import runs as learning_runs
from benchmarks.learning.equal_trials import TRIALS, TUNED_AGENTS, draw_trials, experiments, run, tuned, untuned
from benchmarks.learning.plan import Counts

FEW = Counts(balls=5, shorten=170)


def test_every_agent_has_as_many_trials_with_the_same_draws_and_keeps_its_pace() -> None:
    first = untuned(Counts())
    for agent, ones in experiments(Counts()).items():
        configs = [one.config for one in ones]
        assert len(ones) == TRIALS
        assert learning_runs.fingerprint(configs[0]) == learning_runs.fingerprint(first[agent])
        assert {one.exploration.scale for one in configs[1:]} == {trial.noise for trial in draw_trials()}
        assert {(one.episodes, one.reward.kind, one.ddpg.updates_per_episode) for one in configs} == {
            (1700, configs[0].reward.kind, 4)
        }
        assert {one.rival.updates_per_episode for one in configs} == {4 if agent in ("td3", "sac", "ppo") else 0}
    assert len({learning_runs.fingerprint(one.config) for one in ones}) == TRIALS


def test_the_trial_with_the_lowest_error_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "tuned.toml"
    errors = {agent: [50.0] * TRIALS for agent in TUNED_AGENTS}
    errors["ddpg"][2] = errors["td3"][3] = 40.0
    equal_trials.write_tuned(path, errors)
    found, first = tuned(Counts(), path), untuned(Counts())
    second, third = draw_trials()[1:3]
    assert (found["ddpg"].ddpg.critic_rate, found["ddpg"].ddpg.hidden) == (second.rate, second.hidden)
    assert (found["td3"].rival.rate, found["td3"].rival.hidden) == (third.rate, third.hidden)
    assert found["sac"] == first["sac"], "the first of equals: as it was"
    assert f"| TD3 | 50 | 40 | {third.rate:g} |" in equal_trials.tuning_table(path)


def test_an_interrupted_tuning_goes_on_and_every_trial_has_its_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = {agent: ones for agent, ones in experiments(FEW).items() if agent in ("ddpg", "td3")}
    monkeypatch.setattr(equal_trials, "experiments", lambda counts: {k: few[k][:2] for k in few})
    run(tmp_path / "runs", tmp_path / "tuned.toml", FEW)
    text = (tmp_path / "tuned.toml").read_text()
    assert len(list((tmp_path / "runs").glob("trial-*/seed-*.json"))) == 2 * 2 * equal_trials.SEEDS

    def never(*_: object) -> None:
        raise AssertionError("trained again")

    monkeypatch.setattr(equal_trials, "train_missing", never)
    run(tmp_path / "runs", tmp_path / "tuned.toml", FEW)
    assert (tmp_path / "tuned.toml").read_text() == text
