"""The chain from events to a racket: detect in every camera, triangulate, predict, decide."""

from core.rally.chain.chain import BallPoint, ChainState, RallyChain
from core.rally.chain.config import ChainConfig
from core.rally.chain.follow import Track, follow_recording, true_positions

__all__ = [
    "BallPoint",
    "ChainConfig",
    "ChainState",
    "RallyChain",
    "Track",
    "follow_recording",
    "true_positions",
]
