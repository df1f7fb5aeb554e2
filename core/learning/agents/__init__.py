"""Agents: the paper's agent, the landing model, networks, replay buffer and policies."""
