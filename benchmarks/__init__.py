"""Every benchmark and report of core; nothing imports it but the verbs that run it."""
