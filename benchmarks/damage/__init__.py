"""Damaged files of ours, many thousands: each gives its good part with a note, or one clear line."""
