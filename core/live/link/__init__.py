"""The simulation as its own process: messages, server and client over ZMQ."""
