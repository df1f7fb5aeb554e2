"""Faults brought about while a verb works: kills, full and failing disks, folders that cannot be written, long stops."""
