"""The live rally: the player with its threads, and the ring recording of the last seconds."""
