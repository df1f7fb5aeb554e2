"""The chain from events to a racket: detect in every camera, triangulate, predict, decide."""

from core.rally.chain import BallPoint, ChainState, RallyChain
from core.rally.config import ChainConfig

__all__ = ["BallPoint", "ChainConfig", "ChainState", "RallyChain"]
