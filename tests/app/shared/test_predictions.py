"""The paper's prediction can be chosen for recordings and for the live rally."""

from pathlib import Path

import numpy as np
import pytest

from app.modes.watch.commands import SetPrediction
from app.shared.rallies import Rallies
from app.state.client_state import ClientState, Configs, History, Playhead
from core.chain import ChainConfig
from core.chain.config import published_chain, with_prediction
from core.detection import DetectorConfig
from core.errors import ConfigError
from core.recordings import open_recording
from core.trajectory import FilterPredictor, PaperPredictor


def test_the_prediction_is_exchanged_and_the_detector_stays() -> None:
    chain = ChainConfig()
    paper = with_prediction(chain, "paper")
    predictor = paper.make_predictor()
    assert isinstance(predictor, PaperPredictor) and (paper.predictor.observations, paper.method) == (5, chain.method)
    assert paper.predictor == published_chain().predictor and not paper.estimates_spin
    back = with_prediction(paper, "filter")
    assert back == chain and isinstance(back.make_predictor(), FilterPredictor)
    with pytest.raises(ConfigError, match="filter or paper"):
        with_prediction(chain, "guess")  # type: ignore[arg-type]


def test_a_browser_chooses_only_what_is_offered() -> None:
    configs = History(Configs(DetectorConfig(), DetectorConfig()))
    state = ClientState("serve", ("left",), "left", Playhead(1000), configs)
    chosen = SetPrediction("paper").apply(state, 0.0)
    assert chosen.watch.prediction == "paper"
    assert SetPrediction("guess").apply(chosen, 0.0) == chosen  # type: ignore[arg-type]


def test_a_recording_is_watched_with_the_five_point_fit_before_and_after_the_bounce(serve_recording: Path) -> None:
    rallies = Rallies(prediction="paper")
    with open_recording(serve_recording) as recording:
        try:
            found = {name: rallies.of(recording, name) for name in ("filter", None)}
            hits = {}
            for name, rally in found.items():
                assert rally is not None and rally.following is not None
                rally.following.wait()
                assert rally.followed == 1.0
                hits[name] = rally.history.predicted_hits()
                last = rally.history.at(rally.history.followed_us, {})
                assert last.step is not None and last.step.before is not None
            assert len(hits[None]) and len(hits["filter"]) > len(hits[None]), "the filter predicts from every point"
            paper, usual = (np.array([hit.p_world_m for _, hit in one]) for one in (hits[None], hits["filter"]))
            assert np.isfinite(paper).all() and not np.allclose(paper[-1], usual[-1], atol=1e-6)
        finally:
            rallies.close()
