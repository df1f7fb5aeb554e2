"""The filter that is told nothing beside the ones that are told, on recorded flights that nothing was tuned on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from core.metrics.spinning_flights import foresee_flights, spinning_flights, touches_net
from core.physics.fit_flights import RecordedFlight
from core.trajectory import FilterConfig, FilterPredictor, filter_for

FILTERS: Final[dict[str, tuple[FilterConfig, bool]]] = {
    "told `real`": (filter_for("real"), False),
    "told `paper`": (filter_for("paper"), False),
    "told nothing, each flight alone": (replace(filter_for("paper"), perhaps_real=True), False),
    "told nothing, learning from flight to flight": (replace(filter_for("paper"), perhaps_real=True), True),
}
"""With whether they carry over what they learnt."""


def held_out(flights: Sequence[RecordedFlight]) -> list[RecordedFlight]:
    """Every second flight, in the order of their names: the filter was tuned on the others."""
    return spinning_flights(flights[1::2])


def filter_rows(flights: Sequence[RecordedFlight]) -> list[dict[str, object]]:
    """A row per filter and time ahead, over flights that nothing was tuned on."""
    rows = []
    without = [flight for flight in flights if not touches_net(flight)]
    for name, (config, carry) in FILTERS.items():
        found = foresee_flights(FilterPredictor(config), flights, carry=carry)
        clean = foresee_flights(FilterPredictor(config), without, carry=carry)
        rows += [
            {
                "filter": name,
                "ahead_ms": round(1e3 * ahead),
                "flights": len(flights),
                "predictions": len(one.errors_m),
                "median_mm": 1e3 * one.median_m,
                "worst_tenth_mm": 1e3 * one.worst_tenth_m,
                "nees": one.nees,
                "nees_off_net": clean[ahead].nees,
                "off_net": len(without),
            }
            for ahead, one in found.items()
        ]
    return rows
