"""Faults brought about while a verb works: kills, full and failing disks, read-only folders, long stops."""
