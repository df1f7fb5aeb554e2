"""The chain from events to a racket command: detect in every camera, triangulate, predict, control."""

from core.chain.chain import BallPoint, ChainState, RallyChain
from core.chain.config import ChainConfig
from core.chain.follow import Track, follow_recording, true_positions

__all__ = ["BallPoint", "ChainConfig", "ChainState", "RallyChain", "Track", "follow_recording", "true_positions"]
